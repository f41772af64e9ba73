"""Options of commands that go through a catalogue in parts."""

from __future__ import annotations

import argparse
from typing import Any

from vsh.commands import reading
from vsh.commands.parsing import count


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where a catalogue is read and summed in parts, in every command that reads one.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        To which options are added.
    """
    parser.add_argument(
        "--workers", type=count(1), metavar="N",
        help="go through the catalogue in parts, of any size, with N processes; without this it is read whole",
    )  # fmt: skip
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="the same on the cluster of Dask at this address, or of this scheduler file",
    )


def in_parts(options: argparse.Namespace) -> bool:
    """Whether a command was asked to go through its catalogue in parts.

    Parameters
    ----------
    options : argparse.Namespace
        Of a command.
    """
    return options.workers is not None or options.scheduler is not None


def reading_parts(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `vsh.catalogue.parts` that `add_reading` and `add_workers` ask for.

    Parameters
    ----------
    options : argparse.Namespace
        Of a command.
    """
    return reading.arguments(options) | {"workers": options.workers, "scheduler": options.scheduler}
