"""One style for every figure: a column of a journal wide, sharp when it fills a slide."""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from PIL import Image

from vsh.tools.arguments import choice, positive
from vsh.tools.errors import ParameterError
from vsh.tools.files import MARK, atomic_write
from vsh.tools.types import Axes, Figure, OnAxes, PathName

P = ParamSpec("P")
R = TypeVar("R")
#: A column of a journal, 9 cm. [inch]
WIDTH = 3.54
#: Classes that everybody can tell apart (Okabe & Ito 2008), the three axes first;
#: tests/vsh/figures/plot/test_colours.py.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#e69f00")
#: One colour for each kind in all figures: spin and toroidal harmonics, acceleration and spheroidal ones, scalars.
KIND_COLOURS = {"T": COLOURS[3], "S": COLOURS[1], "F": COLOURS[0]}
KIND_NAMES = {"T": "toroidal", "S": "spheroidal", "F": "scalar"}
#: From little to much; of either sign; of how sure something is. Their luminance never turns back.
SEQUENTIAL, DIVERGING, SIGNIFICANCE = "viridis", "RdBu_r", "viridis_r"
#: What may be nothing but noise.
FADED = "#b3b3b3"
#: matplotlib's settings, for figures of one's own: ``with plt.rc_context(vsh.figures.plot.STYLE): …``
STYLE: Any = {
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize", "figure.titlesize", "figure.labelsize"), 8),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 7),
    "legend.frameon": False, "legend.handletextpad": 0.4, "legend.columnspacing": 1.0,
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("xtick.minor.width", "ytick.minor.width"), 0.4),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    "axes.prop_cycle": plt.cycler(color=COLOURS), "lines.linewidth": 1.0, "lines.markersize": 3.5,
    "errorbar.capsize": 1.5, "hatch.linewidth": 0.3, "figure.figsize": (WIDTH, 2.4), "figure.dpi": 150,
    "savefig.dpi": 300, "figure.constrained_layout.use": True,
    # TrueType: text of a PDF can be searched and is taken by journals.
    **dict.fromkeys(("pdf.fonttype", "ps.fonttype"), 42),
    # Two runs give the same file.
    "svg.hashsalt": "vsh-astrometry",
}  # fmt: skip


def apply_style(draw: Callable[P, R]) -> Callable[P, R]:
    """A function that draws in `STYLE`.

    Parameters
    ----------
    draw : callable
        The function.
    """

    @wraps(draw)
    def with_style(*args: P.args, **kwargs: P.kwargs) -> R:
        with plt.rc_context(STYLE):
            return draw(*args, **kwargs)

    return with_style


def panels(
    ax: OnAxes | None = None, rows: int = 1, columns: int = 1, *, size: tuple[float, float] | None = None, **how: Any
) -> Any:
    """The axes to draw on: those given, or those of a new figure."""
    if ax is None:
        return plt.subplots(rows, columns, figsize=size or (WIDTH, 2.4), squeeze=False, **how)[1].ravel()
    axes = np.ravel(np.asarray(ax, dtype=object))
    if axes.size != rows * columns:
        raise ParameterError(f"this figure has {rows * columns} panels: ax must be as many axes, not {axes.size}")
    return axes


def allow_many_figures() -> Any:
    """A context in which matplotlib does not count open figures: they are closed when all are written."""
    return plt.rc_context({"figure.max_open_warning": 0})


def figure_of(axes_or_figure: Any) -> Figure:
    """The figure that axes are in."""
    artist = np.ravel(np.asarray(axes_or_figure, dtype=object))[0]
    return artist if hasattr(artist, "savefig") else artist.figure


def colour_bar(axes: Axes, image: Any, label: str, **colorbar_options: Any) -> Any:
    """A colour bar under axes, with its label."""
    options: dict[str, Any] = {"orientation": "horizontal", "shrink": 0.7, "pad": 0.04, "aspect": 30} | colorbar_options
    bar = axes.figure.colorbar(image, ax=axes, **options)
    bar.set_label(label)
    if "ticks" not in colorbar_options:
        bar.locator = MaxNLocator(5, steps=[1, 2, 5, 10])  # so that no two numbers touch
        bar.update_ticks()
    bar.outline.set_linewidth(0.4)
    return bar


def set_log_ticks(axis: Any, low: float, high: float) -> None:
    """Three ticks at least of a logarithmic axis where it is short, as plain numbers: 1, 2, 5, 10."""
    if not (1e-4 < low < high < min(160 * low, 1e5)):
        return
    powers_of_ten = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for multiples in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), tuple(np.arange(1, 10, 0.2).round(1))):
        ticks = np.multiply.outer(powers_of_ten, np.array(multiples))
        if np.sum((ticks >= low) & (ticks <= high)) >= 3:
            break
    axis.set_major_locator(LogLocator(subs=multiples))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_above(axes: Axes, columns: int = 4, **options: Any) -> Any:
    """A legend over axes, where it hides no point, of as many columns as there is room for."""
    placement = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.1}
    legend = axes.legend(**placement | {"ncols": columns} | options)
    subplot_spec = axes.get_subplotspec()
    width_share = 1.0 if subplot_spec is None else len(subplot_spec.colspan) / subplot_spec.get_gridspec().ncols
    if columns > 1 and legend.get_window_extent().width > 0.84 * width_share * axes.figure.bbox.width:
        return legend_above(axes, columns - 1, **options)
    return legend


FORMATS = ("png", "pdf", "svg")
#: Nothing that two runs would not have in common.
_METADATA = {
    "png": {"Software": MARK},
    "pdf": {"CreationDate": None, "Creator": MARK},
    "svg": {"Date": None, "Creator": MARK},
}


def make_png(axes: Any, dpi: float = 200) -> bytes:
    """A figure as a PNG of 256 colours, for a page."""
    buffer = io.BytesIO()
    with plt.rc_context(STYLE):
        figure_of(axes).savefig(buffer, format="png", dpi=dpi, metadata=_METADATA["png"])
    # A page holds many: 256 colours are what they need, and a third of the bytes.
    for colours in (256, 32):
        reduced_png = io.BytesIO()
        Image.open(buffer).convert("RGB").quantize(colours).save(reduced_png, format="png", optimize=True)
        if reduced_png.tell() < 150_000:  # else it is like noise, and a scale of 32 steps says as much
            break
    return reduced_png.getvalue()


def close_figures(figures: Iterable[Any]) -> None:
    """Close figures that are not wanted any more."""
    for axes in figures:
        plt.close(figure_of(axes))


def save_figures(
    figures: Mapping[str, Any],
    folder: PathName,
    *,
    format: str | Sequence[str] = "png",
    dpi: float = 300,
    close: bool = True,
    overwrite: bool = False,
) -> list[Path]:
    """Write figures by name into a folder; returns their paths.

    Parameters
    ----------
    figures : dict of str to axes or figure
        What `plot_…` returned, by name of file.
    folder : str or Path
        Where to write.
    format : {"png", "pdf", "svg"}, or several of them
        Format of the files.
    dpi : float
        Dots an inch: of a PNG, and of what is a picture in the others.
    close : bool
        Whether the figures are not wanted any more.
    overwrite : bool
        Whether files that are there are replaced.
    """
    formats = [choice("format", extension, FORMATS) for extension in ([format] if isinstance(format, str) else format)]
    positive("dpi", dpi)
    paths = []
    for name, axes in figures.items():
        figure = figure_of(axes)
        for extension in formats:
            paths.append(Path(folder) / f"{name}.{extension}")
            with atomic_write(paths[-1], overwrite) as temporary_path, plt.rc_context(STYLE):
                figure.savefig(temporary_path, format=extension, dpi=dpi, metadata=_METADATA[extension])
    if close:
        close_figures(figures.values())
    return paths
