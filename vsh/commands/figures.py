"""Figures and pages that a command writes, without a window; each figure is drawn once."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from vsh.checks.types import PathName


class Figures:
    """The figures of a run, drawn when they are first asked for.

    Parameters
    ----------
    draw : callable
        Draws them: a dict of matplotlib axes by name of file.
    """

    def __init__(self, draw: Callable[[], Mapping[str, Any]]) -> None:
        self._draw = draw

    @cached_property
    def drawn(self) -> dict[str, Any]:
        """Axes by name of file."""
        without_windows()
        return dict(self._draw())

    def write(self, folder: Path, options: argparse.Namespace) -> list[Path]:
        """Write them, unless there are to be none; returns their paths."""
        if options.no_figures:
            return []
        from vsh.plot import save_figures

        paths = save_figures(self.drawn, folder, format=options.format, dpi=options.dpi, close=False)
        if not options.html:  # nobody wants them any more
            self.close()
        return paths

    def close(self) -> None:
        """Close them."""
        from vsh.plot import close_figures

        close_figures(self.drawn.values())


def without_windows() -> None:
    """Have matplotlib write files only: a command runs where there may be no screen."""
    import matplotlib

    matplotlib.use("agg")


def write_page(
    path: PathName, title: str, text: str, figures: Figures, *, sheets: Mapping[str, Any] | None = None,
    captions: Mapping[str, str] | None = None, lead: str = "", provenance: Mapping[str, Any] | None = None,
    command: Sequence[str] | None = None,
) -> None:  # fmt: skip
    """Write a page of a run: its figures, tables that sort, what was printed, and where it comes from."""
    from vsh import page

    panels = [
        page.heading("Figures", page.figures(figures.drawn, captions or {})),
        *(page.sheet(heading, columns) for heading, columns in (sheets or {}).items()),
        page.heading("Report", page.preformatted(text.strip("\n"))),
        page.provenance(provenance or {}, command),
    ]
    figures.close()
    page.write_page(path, page.page(title, panels, lead=lead))


def of_page(path: PathName) -> str:
    """What is said of a page with a sky that was written, and if its sky cannot be turned."""
    from vsh.page import STATIC, bundle

    return f"written to {path}" if bundle() else f"written to {path}; its sky {STATIC}"
