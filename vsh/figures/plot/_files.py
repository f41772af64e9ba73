"""Figures as files."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from PIL import Image

from vsh.figures.plot._style import STYLE, figure_of
from vsh.tools.arguments import choice, positive
from vsh.tools.files import MARK, atomic_write
from vsh.tools.types import PathName

FORMATS = ("png", "pdf", "svg")
#: Nothing that two runs would not have in common.
_METADATA = {
    "png": {"Software": MARK},
    "pdf": {"CreationDate": None, "Creator": MARK},
    "svg": {"Date": None, "Creator": MARK},
}


def picture_of(drawn: Any, dpi: float = 200) -> bytes:
    """A figure as a PNG of 256 colours, for a page."""
    buffer = io.BytesIO()
    with plt.rc_context(STYLE):
        figure_of(drawn).savefig(buffer, format="png", dpi=dpi, metadata=_METADATA["png"])
    # A page holds many: 256 colours are what they need, and a third of the bytes.
    for colours in (256, 32):
        small = io.BytesIO()
        Image.open(buffer).convert("RGB").quantize(colours).save(small, format="png", optimize=True)
        if small.tell() < 150_000:  # else it is like noise, and a scale of 32 steps says as much
            break
    return small.getvalue()


def close_figures(figures: Iterable[Any]) -> None:
    """Close figures that are not wanted any more."""
    for drawn in figures:
        plt.close(figure_of(drawn))


def save_figures(
    figures: Mapping[str, Any],
    folder: PathName,
    *,
    format: str | Sequence[str] = "png",
    dpi: float = 300,
    close: bool = True,
) -> list[Path]:
    """Write figures by name into a folder; returns their paths.

    Parameters
    ----------
    figures : dict of str to axes or figure
        What `plot_…` returned, by name of file.
    folder : str or Path
        Where to write.
    format : {"png", "pdf", "svg"}, or several of them
        Of the files.
    dpi : float
        Dots an inch: of a PNG, and of what is a picture in the others.
    close : bool
        Whether the figures are not wanted any more.

    Returns
    -------
    list[Path]

    Raises
    ------
    ParameterError
        If nobody knows the format, or `dpi` is not positive.
    """
    formats = [choice("format", each, FORMATS) for each in ([format] if isinstance(format, str) else format)]
    positive("dpi", dpi)
    paths = []
    for name, drawn in figures.items():
        figure = figure_of(drawn)
        for each in formats:
            paths.append(Path(folder) / f"{name}.{each}")
            with atomic_write(paths[-1]) as new, plt.rc_context(STYLE):
                figure.savefig(new, format=each, dpi=dpi, metadata=_METADATA[each])
    if close:
        close_figures(figures.values())
    return paths
