"""Sources and the motions fitted to them: arrows along their great circles."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from vsh.basis import harmonics, scalar_harmonics
from vsh.coefficients import Coefficients
from vsh.field import Field
from vsh.figures.plot._sky_axes import (
    HALO,
    PROJECTIONS,
    SkyAxes,
    draw_direction,
    draw_empty,
    draw_sources,
    plot_map,
    sky_axes,
)
from vsh.figures.plot._style import COLOURS, DIVERGING, FADED, KIND_COLOURS, SIGNIFICANCE, apply_style, colour_bar
from vsh.scalars import ScalarCoefficients, ScalarField
from vsh.sky.pixels import centres
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray
from vsh.vector import SEEN, chance_probability

#: Length of the largest arrow; a little less than the step of the grid. [deg]
LONGEST = 11.0
#: Points along an arrow; the shares of it before its place, the first that fits on the map being taken.
_POINTS = 13
#: Style of the arrow that tells how long others are, and of its words.
_KEY_STYLE: Any = {"fontsize": 6, "color": "0.25", "path_effects": HALO}
_PLACES = ((0.5, 1.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5), (0.0, 0.5), (1.0, 0.5), (0.5, 0.2), (0.0, 0.2), (1.0, 0.2))


def draw_vectors(
    axes: SkyAxes,
    lon: FloatArray,
    lat: FloatArray,
    motion: FloatArray,
    *,
    scale: float | None = None,
    longest: float = LONGEST,
    color: Any = "#0072b2",
    linewidth: float = 0.8,
    **style: Any,
) -> Any:
    """Motions as arrows along their great circles, each in the middle of its place.

    One that would go over the seam or the limb of the map stands before or behind its place, or is shortened: none is
    split, bent or left out, but those on the far side of a globe.

    Parameters
    ----------
    axes : SkyAxes
        The map.
    lon, lat : (n,) arrays
        [rad]
    motion : (2, n) array
        East and north. [µas/yr]
    scale : float, optional
        The motion that is drawn `longest`; the largest unless given.
    longest : float
        On the sky. [deg]
    color : colour, or (n, 4) array
        Colour of all arrows, or of each.
    linewidth : float
        Width of the shafts. [points]
    **style
        Style of both shafts and heads.

    Returns
    -------
    shafts : matplotlib LineCollection
        Drawn, tail to tip; a segment for each arrow, in the order given.

    Raises
    ------
    ParameterError
        If the motions are not as many as the places.
    """
    lon, lat, motion = np.atleast_1d(lon).astype(float), np.atleast_1d(lat).astype(float), np.asarray(motion, float)
    if motion.shape != (2, lon.size) or lat.shape != lon.shape:
        raise ParameterError(f"lon, lat and motion have shapes {lon.shape}, {lat.shape} and {motion.shape}")
    amplitude = np.hypot(*motion)
    has_motion = np.isfinite(amplitude) & (amplitude > 0)
    lon, lat, motion, amplitude = lon[has_motion], lat[has_motion], motion[:, has_motion], amplitude[has_motion]
    scale = scale or float(amplitude.max(initial=0.0)) or 1.0
    lines, fits = make_arrow_lines(axes, lon, lat, motion, np.radians(longest) * amplitude / scale)
    if np.ndim(color) == 2:
        color = np.asarray(color)[has_motion][fits]
    style = {"zorder": 4} | style
    shafts = LineCollection(list(lines), colors=color, linewidths=linewidth, capstyle="butt", **style)
    heads = PolyCollection(_make_heads(lines, 4.2 * linewidth + 8.0), facecolors=color, edgecolors="none", **style)
    axes.add_collection(shafts, autolim=False)
    axes.add_collection(heads, autolim=False)
    return shafts


def draw_arrow_key(axes: SkyAxes, largest_motion: float, unit: str, longest: float = LONGEST) -> None:
    """An arrow of a round length beside the map, where one of the size `largest` is drawn `longest` [deg]."""
    length = _round_up(1.5 * largest_motion)
    arrow_share = np.radians(longest) / (2 * PROJECTIONS[axes.projection_name][1]) * length / largest_motion
    arrow_style = {"arrowstyle": "-|>,head_width=0.12,head_length=0.25", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    ends = (arrow_share, 0.075), (0.0, 0.075)
    axes.annotate("", *ends, xycoords="axes fraction", arrowprops=arrow_style | {"color": _KEY_STYLE["color"]})
    axes.text(0.0, -0.012, f"{length:g} {unit}", transform=axes.transAxes, va="bottom", **_KEY_STYLE)


def make_arrow_lines(
    axes: SkyAxes, lon: FloatArray, lat: FloatArray, motion: FloatArray, length: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points on the map of each arrow that fits there, tail to tip, and which arrows do, a mask."""
    p, q, r = triad(lon, lat)
    east, north = motion / np.hypot(*motion)
    direction = east * p + north * q
    lines = np.full((lon.size, _POINTS, 2), np.nan)
    unplaced = np.arange(lon.size)
    for share_before, length_share in _PLACES:
        if not unplaced.size:
            break
        angle = (np.linspace(0, 1, _POINTS)[:, None] - share_before) * length_share * length[unplaced]
        points = np.cos(angle) * r[:, None, unplaced] + np.sin(angle) * direction[:, None, unplaced]
        point_lon, point_lat = angles(points.reshape(3, -1))
        xy, native_lon = axes.project(point_lon.reshape(angle.shape), point_lat.reshape(angle.shape))
        is_on_map = np.isfinite(xy).all((0, 2))
        if axes.is_whole:
            is_on_map &= (np.abs(np.diff(native_lon, axis=0)) < 180).all(0)
        lines[unplaced[is_on_map]] = np.moveaxis(xy[:, is_on_map], 0, 1)
        unplaced = unplaced[~is_on_map]
    fits = np.isfinite(lines).all((1, 2))
    return lines[fits], fits


def _make_heads(lines, head_length):
    """Triangles at the tips."""
    if not len(lines):
        return []
    tip = lines[:, -1]
    chord = np.hypot(*(tip - lines[:, 0]).T)[:, None]
    forward = tip - lines[:, -3]
    forward = forward / np.maximum(np.hypot(*forward.T), 1e-12)[:, None]
    across = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    head_length = np.minimum(head_length, 0.55 * chord)
    base, half_width = tip - 0.75 * head_length * forward, 0.42 * head_length * across
    return list(np.stack([tip + 0.25 * head_length * forward, base + half_width, base - half_width], axis=1))


def even_grid(step: float = 12.0) -> tuple[FloatArray, FloatArray]:
    """Positions about `step` degrees apart all over the sky: lon, lat. [rad]"""
    latitudes = np.arange(-90 + step / 2, 90, step)
    counts = [max(1, round(360 * np.cos(np.radians(degrees)) / step)) for degrees in latitudes]
    return _join_rings((degrees, (np.arange(n) + 0.5) * 360 / n) for degrees, n in zip(latitudes, counts, strict=True))


def _join_rings(rings):
    """Longitudes and latitudes of rings, each a latitude and its longitudes [deg]: two arrays [rad]."""
    latitudes, longitudes = zip(*rings, strict=True)
    return np.radians(np.concatenate(longitudes)), np.radians(np.repeat(latitudes, [*map(len, longitudes)]))


def arrow_grid(axes: SkyAxes, step: float = 12.0) -> tuple[FloatArray, FloatArray]:
    """Positions evenly placed on a map, half a step off its rim: as many wherever its centre is."""
    return axes.of_native(*_join_rings(_place_whole_sky_rings(step) if axes.is_whole else _place_half_sky_rings(step)))


def _place_whole_sky_rings(step):
    """Rows of native latitude, each from half a step after the seam to half a step before it."""
    for degrees in np.arange(-90 + step / 2, 90, step):
        # A place so far from the meridian of the seam that an arrow of half a step does not reach it.
        sine = np.sin(np.radians(step / 2)) / np.cos(np.radians(degrees))
        reach = 180 - np.degrees(np.arcsin(min(1.0, sine)))
        n = max(1, 1 + int(2 * reach * np.cos(np.radians(degrees)) / step + 1e-9))
        if degrees < -90 + 0.75 * step or degrees > 90 - 0.75 * step:
            reach, n = 60.0, 3  # about the pole, which the seam ends at
        yield degrees, np.linspace(-reach, reach, n) if n > 1 else np.zeros(1)


def _place_half_sky_rings(step):
    """The middle, and rings about it to half a step off the limb."""
    yield 90.0, np.zeros(1)
    n_rings = int((90 - step / 2) / step)
    for i in range(1, n_rings + 1):
        distance = i * (90 - step / 2) / n_rings
        n = max(6, round(360 * np.sin(np.radians(distance)) / step))
        yield 90 - distance, (np.arange(n) + 0.5 * (i % 2)) * 360 / n


#: Chance of an arrow of noise to be coloured; its distance from zero is that of two components, √(vᵀC⁻¹v). An arrow is
#: grey below that distance, and none is as dark as can be below the second.
CHANCE = 0.05
SURE, TOP = float(np.sqrt(-2 * np.log(CHANCE))), 6.0


def compute_significance(motion: FloatArray, basis: FloatArray, covariance: FloatArray) -> FloatArray:
    """√(vᵀC⁻¹v) of each motion, whose square is χ² with two degrees of freedom where there is noise alone."""
    motion_covariance = np.einsum("pin,pq,qjn->nij", basis, covariance, basis, optimize=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        (a, c), (_, b) = np.moveaxis(motion_covariance, 0, -1)
        east, north = motion
        return np.asarray(np.sqrt((east**2 * b - 2 * east * north * c + north**2 * a) / (a * b - c**2)))


def compute_smallest_chance(coefficients: Coefficients, covariance: FloatArray) -> float:
    """The smallest probability that noise alone gives such a spin, such a glide, or such coefficients, or larger ones.

    All coefficients alone would not do: those that a systematic floor holds back are small by their errors, so that a
    spin which is seen would be hidden among them. It is 1 where the covariance is not known.
    """
    if not np.isfinite(covariance).all():
        return 1.0
    modes = coefficients.modes
    parts = [slice(None), *(modes.slice_of(kind, 1) for kind in modes.kinds)]
    return min(_compute_noise_chance(coefficients.values[part], covariance[part, part]) for part in parts)


def _compute_noise_chance(values, covariance):
    # A covariance from few draws is singular: what they did not vary is not asked about.
    variances, axes = np.linalg.eigh(covariance)
    is_varied = variances > 1e-12 * variances[-1]
    chi2 = np.sum((values @ axes)[is_varied] ** 2 / variances[is_varied])
    return chance_probability(float(chi2), int(is_varied.sum()))


@apply_style
def plot_field(
    field: Field | None,
    coefficients: Coefficients,
    *,
    covariance: FloatArray | None = None,
    title: str | None = None,
    unit: str = "µas/yr",
    frame: str = "icrs",
    ax: Axes | None = None,
    projection: str = "hammer",
    centre: tuple[float, float] | None = None,
) -> SkyAxes:
    """The sources of a field and the motions fitted to them, as sure as they are.

    Arrows stand evenly on the map; with a covariance their colour is their distance from zero, √(vᵀC⁻¹v), and grey
    where noise alone gives as much with a chance of 5 % or more; all are grey where the field is not detected. Stars
    with cones are where acceleration and spin point; hatched is where no source stands.

    Parameters
    ----------
    field : Field, optional
        The sources; at most 20 000 are drawn. None draws the motions alone.
    coefficients : Coefficients
        The field. [µas/yr]
    covariance : (p, p) array, optional
        Covariance of the coefficients.
    title : str, optional
        Title of the figure.
    unit : str
        Unit of the motions.
    frame : str
        Axes of the coefficients, where there is no field.
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
    is_covariance_known = covariance is not None and bool(np.isfinite(covariance).all())
    chance = compute_smallest_chance(coefficients, np.asarray(covariance)) if is_covariance_known else 0.0
    is_noise = chance >= SEEN
    room_below = 0.95 if covariance is not None and not is_noise else 0.5
    axes = sky_axes(frame if field is None else field.frame, ax, projection=projection, centre=centre, below=room_below)
    hatching = _draw_sources_and_gaps(axes, field)
    lon, lat = arrow_grid(axes)
    motion = coefficients.at(lon, lat)
    colour: Any = COLOURS[0]
    if is_noise:
        colour = _NOISE_COLOUR
    elif is_covariance_known:
        basis = harmonics(lon, lat, modes)
        significance = np.nan_to_num(compute_significance(motion, basis, np.asarray(covariance)))
        reach = float(np.percentile(significance, 95))
        top = TOP if reach <= TOP else _round_up(reach)
        colour = _make_significance_colormap(top)(np.clip(significance, 0, top) / top)
    draw_vectors(axes, lon, lat, motion, color=colour)
    largest_motion = float(np.hypot(*motion).max())
    if largest_motion > 0:
        draw_arrow_key(axes, largest_motion, unit)
    names = ("spin", "acceleration") if unit == "µas/yr" else ("rotation", "glide")
    handles, legend_title = _draw_direction_stars(axes, coefficients, covariance, names)
    if hatching is not None:
        handles.append(_make_gap_legend_handle())
    if is_noise:
        label = f"not detected, p = {chance:.2g}"
        handles.append(Patch(facecolor=_NOISE_COLOUR, linewidth=0.0, label=label))
    if handles:
        placement: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.02), "borderaxespad": 0, "ncols": 2}
        sizes: Any = {"fontsize": 6.5, "title_fontsize": 6.5, "columnspacing": 1.0, "handlelength": 1.4}
        axes.legend(handles=handles, title=legend_title, **placement, **sizes)
    if is_covariance_known and not is_noise:
        scale = ScalarMappable(Normalize(0, top), _make_significance_colormap(top))
        bar = colour_bar(axes, scale, r"$\sqrt{v^T C^{-1} v}$ of an arrow (grey: $p > 0.05$)", extend="max", shrink=0.6)
        bar.set_ticks(MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]).tick_values(0, top))
    title_start = "T" if field is None else f"{len(field)} sources and t"
    axes.set_title(title or f"{title_start}he field fitted to degree {modes.lmax}")
    return axes


def _make_gap_legend_handle():
    return Patch(facecolor="none", edgecolor="0.55", hatch="//////", linewidth=0.0, label="no sources")


def _draw_sources_and_gaps(axes, field, **style):
    """Dots where sources stand, and hatching where none does; nothing without a field."""
    if field is None:
        return None
    draw_sources(axes, field.lon, field.lat, **style)
    return draw_empty(axes, field.lon, field.lat)


@apply_style
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
    surest = np.argsort(-np.sum((field.motion / field.sigma) ** 2, 0), kind="stable")[:n_arrows]
    amplitude = np.hypot(*field.motion[:, surest])
    longest = float(np.quantile(amplitude, 0.9)) if len(surest) else 0.0
    if longest > 0:
        motion = field.motion[:, surest] * np.minimum(1, longest / np.maximum(amplitude, 1e-300))
        draw_vectors(axes, field.lon[surest], field.lat[surest], motion, scale=longest, linewidth=0.5)
        title_remark = "" if len(surest) == len(field) else f", motions of the {len(surest)} surest"
        axes.set_title(f"{len(field)} sources{title_remark}; longest arrow {longest:.3g} µas/yr", fontsize="small")
    return axes


#: Arrows of a field that noise alone would give.
_NOISE_COLOUR = "0.45"


def _round_up(number):
    """The next of 1, 1.5, 2, 3, 5, 10, 15, …"""
    power_of_ten = 10 ** np.floor(np.log10(number))
    return float(min(k * power_of_ten for k in (1, 1.5, 2, 3, 5, 10) if k * power_of_ten >= number))


def _make_significance_colormap(top):
    steps = np.linspace(0, 1, 256)
    colours = mpl.colormaps[SIGNIFICANCE](steps)
    colours[steps < SURE / top] = mpl.colors.to_rgba(FADED)
    return ListedColormap(colours)


def _draw_direction_stars(axes, coefficients, covariance, names):
    """Stars of acceleration and spin, and why arrows need not meet there."""
    handles, detected_names = [], []
    for kind, name in (("S", names[1]), ("T", names[0])):
        vector = coefficients.vector(kind, covariance, axes.sky_frame)
        if vector.value.any():
            handles.append(draw_direction(axes, vector, name, KIND_COLOURS[kind]))
            if covariance is None or vector.p_value < SEEN:
                detected_names.append(name)
    needs_remark = names[1] in detected_names and (coefficients.modes.lmax > 1 or len(detected_names) > 1)
    return handles, "arrows: all degrees together; they need not meet at a star" if needs_remark else None


@apply_style
def plot_scalar_field(
    field: ScalarField | None,
    coefficients: ScalarCoefficients,
    *,
    covariance: FloatArray | None = None,
    title: str | None = None,
    unit: str = "",
    frame: str = "icrs",
    ax: Axes | None = None,
) -> SkyAxes:
    """A map of a scalar field as fitted less its mean, and its sources, each where it is.

    With a covariance the colours are full from four errors of the map on, so that noise alone stays pale.

    Parameters
    ----------
    field : ScalarField, optional
        The sources; at most 20 000 are shown. None draws the map alone.
    coefficients : ScalarCoefficients
        The field drawn.
    covariance : (p, p) array, optional
        Covariance of the coefficients.
    title : str, optional
        Above the map.
    unit, frame : str
        Unit and axes of the coefficients, where there is no field.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given.
    """
    values = coefficients.at(*centres(32)) - coefficients.mean
    reach = float(np.abs(values).max()) or 1.0
    if covariance is not None and np.isfinite(covariance).all():
        basis = scalar_harmonics(*centres(4), coefficients.modes.lmax)[1:]
        reach = max(reach, 4 * float(np.sqrt(np.median(np.einsum("pn,pq,qn->n", basis, covariance[1:, 1:], basis)))))
    unit, frame = (unit, frame) if field is None else (field.unit, field.frame)
    label = f"value less its mean{f'  [{unit}]' if unit else ''}"
    axes = plot_map(values, label, frame=frame, cmap=DIVERGING, title=title, ax=ax, vmin=-reach, vmax=reach)
    if _draw_sources_and_gaps(axes, field, color="0.15", alpha=0.5) is not None:
        axes.legend(handles=[_make_gap_legend_handle()], loc="upper right", bbox_to_anchor=(1.0, 1.0), fontsize=6.5)
    return axes
