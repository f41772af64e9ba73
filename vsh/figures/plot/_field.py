"""Sources and the motions fitted to them."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patches import Patch
from scipy.special import chdtrc

from vsh.basis import harmonics
from vsh.coefficients import Coefficients
from vsh.field import Field
from vsh.figures.plot._arrows import arrow_grid, draw_key, draw_vectors
from vsh.figures.plot._maps import draw_empty, plot_map
from vsh.figures.plot._marks import draw_direction, draw_sources
from vsh.figures.plot._sky_axes import SkyAxes, sky_axes
from vsh.figures.plot._style import COLOURS, DIVERGING, FADED, SIGNIFICANCE, colour_bar, styled
from vsh.scalars import ScalarCoefficients, ScalarField
from vsh.sky.pixels import centres
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray
from vsh.vector import SEEN

#: An arrow is grey below, and as dark as any from there on. [σ]
SURE, TOP = 2.0, 6.0


def significance_of(motion: FloatArray, basis: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Amplitude over its error, along the motion, and that error."""
    amplitude = np.hypot(*motion)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.einsum("pin,in->pn", basis, motion / amplitude)
        error = np.sqrt(np.einsum("pn,pq,qn->n", along, covariance, along, optimize=True))
        return amplitude / error, error


def _is_seen(values: FloatArray, covariance: FloatArray) -> bool:
    """Whether noise alone gives such coefficients in less than 0.27 % of skies."""
    if not np.isfinite(covariance).all():
        return False
    return bool(chdtrc(len(values), values @ np.linalg.solve(covariance, values)) < SEEN)


@styled
def plot_field(
    field: Field,
    coefficients: Coefficients,
    *,
    covariance: FloatArray | None = None,
    title: str | None = None,
    unit: str = "µas/yr",
    ax: Axes | None = None,
    projection: str = "hammer",
    centre: tuple[float, float] | None = None,
) -> SkyAxes:
    """The sources of a field and the motions fitted to them, as sure as they are.

    Arrows stand evenly on the map; with a covariance their colour is amplitude over error, and grey below 2. Stars with
    cones are where acceleration and spin point; hatched is where no source stands.

    Parameters
    ----------
    field : Field
        The sources; at most 20 000 are drawn.
    coefficients : Coefficients
        The field. [µas/yr]
    covariance : (p, p) array, optional
        Covariance of the coefficients.
    title : str, optional
        Title of the figure.
    unit : str
        Unit of the motions.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given.
    projection, centre
        As for `vsh.figures.plot.sky_axes`.

    Raises
    ------
    ParameterError
        If the covariance is not of these coefficients.
    """
    modes = coefficients.modes
    if covariance is not None and np.shape(covariance) != (len(modes), len(modes)):
        raise ParameterError(f"covariance has shape {np.shape(covariance)}, the coefficients are {len(modes)}")
    axes = sky_axes(field.frame, ax, projection=projection, centre=centre, below=1.0)
    draw_sources(axes, field.lon, field.lat)
    hatched = draw_empty(axes, field.lon, field.lat)
    lon, lat = arrow_grid(axes)
    motion = coefficients.at(lon, lat)
    colour: Any = COLOURS[0]
    is_noise = covariance is not None and not _is_seen(coefficients.values, np.asarray(covariance))
    if is_noise:
        colour = "0.7"
    elif covariance is not None:
        basis = harmonics(lon, lat, modes)
        sure, _ = significance_of(motion, basis, np.asarray(covariance))
        colour = _colours()(np.clip(np.nan_to_num(sure), 0, TOP) / TOP)
    draw_vectors(axes, lon, lat, motion, color=colour)
    largest = float(np.hypot(*motion).max())
    if largest > 0:
        draw_key(axes, largest, unit)
    names = ("spin", "acceleration") if unit == "µas/yr" else ("rotation", "glide")
    handles, why = _directions(axes, coefficients, covariance, names)
    if hatched is not None:
        handles.append(Patch(facecolor="none", edgecolor="0.55", hatch="//////", linewidth=0.0, label="no sources"))
    if is_noise:
        handles.append(Patch(facecolor="0.7", linewidth=0.0, label="not detected"))
    if handles:
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.02),
            ncols=2,
            borderaxespad=0,
            fontsize=6.5,
            title=why,
            title_fontsize=6.5,
        )
    if covariance is not None and not is_noise:
        scale = ScalarMappable(Normalize(0, TOP), _colours())
        bar = colour_bar(axes, scale, r"$|v|/\sigma$ of an arrow (grey: below 2)", extend="max", shrink=0.6)
        bar.set_ticks(range(0, int(TOP) + 1))
    axes.set_title(title or f"{len(field)} sources and the field fitted to degree {modes.lmax}")
    return axes


@styled
def plot_sources(field: Field, *, n_arrows: int = 300, ax: Axes | None = None) -> SkyAxes:
    """The sources of a field as dots, and the motions that are surest in their errors as arrows.

    Parameters
    ----------
    field : Field
        The sources; at most 20 000 are drawn.
    n_arrows : int
        How many motions are.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given.
    """
    axes = sky_axes(field.frame, ax)
    draw_sources(axes, field.lon, field.lat)
    sure = np.argsort(-np.sum((field.motion / field.sigma) ** 2, 0), kind="stable")[:n_arrows]
    size = np.hypot(*field.motion[:, sure])
    longest = float(np.quantile(size, 0.9)) if len(sure) else 0.0
    if longest > 0:
        shown = field.motion[:, sure] * np.minimum(1, longest / np.maximum(size, 1e-300))
        draw_vectors(axes, field.lon[sure], field.lat[sure], shown, scale=longest, linewidth=0.5)
        axes.set_title(f"{len(field)} sources; longest arrow {longest:.3g} µas/yr", fontsize="small")
    return axes


def _colours():
    steps = np.linspace(0, 1, 256)
    colours = mpl.colormaps[SIGNIFICANCE](steps)
    colours[steps < SURE / TOP] = mpl.colors.to_rgba(FADED)
    return ListedColormap(colours)


def _directions(axes, coefficients, covariance, names):
    """Stars of acceleration and spin, and why arrows need not meet there."""
    handles, shown = [], []
    for kind, name, colour in (("S", names[1], COLOURS[1]), ("T", names[0], COLOURS[3])):
        vector = coefficients.vector(kind, covariance, axes.sky_frame)
        if vector.value.any():
            handles.append(draw_direction(axes, vector, name, colour))
            if covariance is None or vector.p_value < SEEN:
                shown.append(name)
    others = names[1] in shown and (coefficients.modes.lmax > 1 or len(shown) > 1)
    return handles, "arrows: all degrees together; they need not meet at a star" if others else None


@styled
def plot_scalar_field(
    field: ScalarField, coefficients: ScalarCoefficients, *, title: str | None = None, ax: Axes | None = None
) -> SkyAxes:
    """A map of a scalar field as fitted, and its sources, each where it is.

    Parameters
    ----------
    field : ScalarField
        The sources; at most 20 000 are shown.
    coefficients : ScalarCoefficients
        The field drawn.
    title : str, optional
        Above the map.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given.
    """
    values = coefficients.at(*centres(32))
    middle = float(np.median(values))
    reach = float(np.abs(values - middle).max()) or 1.0
    label = f"the field as fitted{f'  [{field.unit}]' if field.unit else ''}"
    axes = plot_map(
        values, label, frame=field.frame, cmap=DIVERGING, title=title, ax=ax, vmin=middle - reach, vmax=middle + reach
    )
    draw_sources(axes, field.lon, field.lat, color="0.15", alpha=0.5)
    draw_empty(axes, field.lon, field.lat)
    return axes
