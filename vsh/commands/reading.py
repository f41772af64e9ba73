"""Options of the commands that read a catalogue, and of those that write figures."""

from __future__ import annotations

import argparse
from typing import Any

from vsh.commands import parsing
from vsh.sky.frames import FRAMES

#: As `vsh.catalogue` has them, which loads too much for --help.
_SETS = ("gaia", "vizier")


def add_reading(parser: argparse.ArgumentParser) -> None:
    """The options of every command that reads a catalogue.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        To which options are added.
    """
    parser.add_argument("--frame", choices=list(FRAMES), default="icrs", help="axes of the result (default: icrs)")
    parser.add_argument(
        "--catalogue-frame", choices=list(FRAMES), help="axes of the catalogue's positions and motions (default: icrs)"
    )
    parser.add_argument(
        "--columns",
        type=_columns,
        metavar="ROLE=NAME,…",
        help="where the table keeps what: gaia (default), vizier, pmra=mu_ra,redshift=z, or vizier,redshift=zsp",
    )
    parser.add_argument("--units", type=parsing.pairs, metavar="NAME=UNIT,…", help="units of columns: mu_ra=uas/yr")
    parser.add_argument(
        "--on-bad", choices=["raise", "drop"], default="raise", help="rows that cannot be used (default: raise)"
    )
    parser.add_argument(
        "--where", metavar="CONDITION", help="rows to use: 'phot_g_mean_mag < 19 and 0.5 < redshift < 2'"
    )
    parser.add_argument("--output", metavar="DIR", type=_named, help="write report, tables and figures to this folder")
    add_figures(parser)
    parsing.add_overwrite(parser)


def add_figures(parser: argparse.ArgumentParser) -> None:
    """Add --format, --dpi, --no-figures and --html.

    Parameters
    ----------
    parser : ArgumentParser
        Of a command.
    """
    parser.add_argument("--format", choices=["png", "pdf", "svg"], default="png", help="of the figures (default: png)")
    parser.add_argument("--dpi", type=parsing.positive, default=300, help="dots an inch of the figures (default: 300)")
    parser.add_argument("--no-figures", action="store_true", help="write no figures into the folder of --output")
    parser.add_argument("--html", metavar="FILE", help="write everything into one page that needs no network")


def arguments(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `read_field` that `add_reading` asks for.

    Parameters
    ----------
    options : argparse.Namespace
        Of a command.
    """
    return {
        "columns": options.columns,
        "units": options.units,
        "on_bad": options.on_bad,
        "frame": options.catalogue_frame,
        "where": options.where,
    }


def _columns(text):
    """NAME=VALUE,… with one of the sets of names before it."""
    first, _, rest = text.partition(",")
    if "=" in first:
        return parsing.pairs(text)
    if first.strip() not in _SETS:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form name=value,name=value, {' or '.join(_SETS)} before it or not"
        )
    return {"names": first.strip()} | (parsing.pairs(rest) if rest else {})


def _named(text):
    if not text:
        raise argparse.ArgumentTypeError("names no folder")
    return text
