"""Figures that a command writes, without a window."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def without_windows() -> None:
    """Have matplotlib write files only: a command runs where there may be no screen."""
    import matplotlib

    matplotlib.use("agg")


def write_figures(draw: Callable[[], Mapping[str, Any]], folder: Path, options: argparse.Namespace) -> list[Path]:
    """Draw and write figures, unless there are to be none; returns their paths.

    Parameters
    ----------
    draw : callable
        Draws them: a dict of axes by name of file.
    folder : Path
        Where to write.
    options : argparse.Namespace
        With those of `vsh.commands.parsing.add_figures`.

    Returns
    -------
    list[Path]
    """
    if options.no_figures:
        return []
    without_windows()
    from vsh.plot import save_figures

    return save_figures(draw(), folder, format=options.format, dpi=options.dpi)
