"""Axes that show the sky (astropy's WCSAxes), of any projection and centre, with marks and maps on them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from astropy.visualization.wcsaxes import WCSAxes
from astropy.visualization.wcsaxes.frame import EllipticalFrame
from astropy.wcs import WCS
from matplotlib.patheffects import withStroke
from scipy.spatial import cKDTree

from vsh.figures.plot._style import DIVERGING, SEQUENTIAL, WIDTH, apply_style, colour_bar
from vsh.sky.frames import ANGLES, check_frame, title_of
from vsh.sky.pixels import pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import choice, in_unit
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, Axes, FloatArray
from vsh.vector import Vector

#: FITS's names of the projections (Calabretta & Greisen 2002), and the radius of each along the abscissa. [rad]
PROJECTIONS = {
    "hammer": ("AIT", 2 * np.sqrt(2)),
    "mollweide": ("MOL", 2 * np.sqrt(2)),
    "globe": ("SIN", 1.0),
    "polar": ("ZEA", np.sqrt(2)),
}
_WHOLE_SKY = ("hammer", "mollweide")
_AXIS_CODES = {"icrs": ("RA--", "DEC-"), "galactic": ("GLON", "GLAT"), "ecliptic": ("ELON", "ELAT")}
#: Width of the map in pixels, in which everything is drawn.
_WIDTH_IN_PIXELS = 1000
#: A point of type is so many pixels of a whole sky that is 9 cm wide.
_POINT = _WIDTH_IN_PIXELS / (WIDTH * 72)
_SIZE = 6.0
HALO = [withStroke(linewidth=1.6, foreground="white")]


#: Look of the numbers of the graticule: over dots and arrows, under cones and stars.
_LABEL_STYLE: Any = {"fontsize": _SIZE, "color": "0.25", "zorder": 4.5, "gid": "graticule"}


class SkyAxes(WCSAxes):
    """A map of the sky, east to the left; made by `sky_axes`, drawn on by `draw_vectors` and its like.

    Attributes
    ----------
    sky_frame, projection_name : str
        What is shown, and how.
    centre : (float, float)
        Longitude and latitude of its middle. [deg]
    """

    sky_frame: str
    projection_name: str
    centre: tuple[float, float]

    @property
    def is_whole(self) -> bool:
        """Return whether all of the sky is shown, and not the half about the centre."""
        return self.projection_name in _WHOLE_SKY

    def project(self, lon: ArrayLike, lat: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Positions on the map, and their longitude from its central meridian, for `lon`, `lat` of one shape. [rad]

        Returns
        -------
        xy : (…, 2) array
            In the map's pixels; NaN where not shown.
        native : (…) array
            Longitude about the map's own pole, −180 to 180: the seam of a whole sky is where it jumps. [deg]
        """
        lon, lat = np.broadcast_arrays(np.degrees(in_unit("lon", lon)), np.degrees(in_unit("lat", lat)))
        if lon.size == 0:
            return np.zeros((*lon.shape, 2)), np.zeros(lon.shape)
        projection = self.wcs.wcs.s2p(np.stack([lon.ravel(), lat.ravel()], axis=1), 0)
        xy, native = projection["pixcrd"].copy(), projection["phi"].copy()
        is_hidden = np.asarray(projection["stat"]) != 0
        if not self.is_whole:
            is_hidden |= projection["theta"] < 0
        xy[is_hidden] = np.nan
        return xy.reshape(*lon.shape, 2), native.reshape(lon.shape)

    def sky_of(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Positions on the sky of the pixels `x`, `y` of the map, (n,).

        Returns
        -------
        lon, lat : (n,) arrays
            Positions, NaN off the map. [rad]
        """
        with np.errstate(invalid="ignore"):
            lon, lat = np.radians(self.wcs.wcs_pix2world(np.stack([x, y], axis=1), 0)).T
        return lon, lat

    def of_native(self, phi: ArrayLike, theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Position on the sky of a place in the map's own coordinates.

        Parameters
        ----------
        phi, theta : (n,) arrays
            Longitude and latitude about the map's own pole, as if nothing were turned. [rad]

        Returns
        -------
        lon, lat : (n,) arrays
            Positions. [rad]
        """
        upright = _make_wcs(self.sky_frame, self.projection_name, (0.0, 0.0 if self.is_whole else 90.0))
        if not self.is_whole:
            upright.wcs.lonpole = 0.0
            upright.wcs.set()
        x, y = upright.wcs_world2pix(np.degrees(np.stack([phi, theta], axis=1)), 0).T
        return self.sky_of(x, y)


@apply_style
def sky_axes(
    frame: str = "icrs",
    ax: Axes | None = None,
    *,
    projection: str = "hammer",
    centre: tuple[float, float] | None = None,
    below: float = 0.0,
) -> SkyAxes:
    """A map of the sky to draw on, longitude increasing to the left.

    Parameters
    ----------
    frame : str
        "icrs", "galactic" or "ecliptic": named on the map.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given. A `SkyAxes` is returned as it is.
    projection : {"hammer", "mollweide", "globe", "polar"}
        The whole sky in an ellipse of equal areas, by Hammer or Mollweide; or half of it, as a globe or of equal areas.
    centre : (float, float), optional
        Longitude and latitude in the middle; (0, 0), of "polar" the north pole, unless given. [deg]
    below : float
        Room for a colour bar or a legend under the map of a new figure. [inch]

    Raises
    ------
    FrameError
        If nobody knows the frame.
    ParameterError
        If nobody knows the projection, the centre is no place, or `ax` is a map of another frame.

    Notes
    -----
    The projections are those of Calabretta & Greisen (2002, A&A 395, 1077), turned by astropy's WCS.
    """
    check_frame(frame)
    choice("projection", projection, tuple(PROJECTIONS))
    if isinstance(ax, SkyAxes):
        if ax.sky_frame != frame:
            raise ParameterError(f"the map is in {ax.sky_frame} axes, what is drawn on it in {frame}")
        return ax
    centre = _resolve_centre(centre, projection)
    wcs = _make_wcs(frame, projection, centre)
    is_whole = projection in _WHOLE_SKY
    options: dict[str, Any] = {"axes_class": SkyAxes, "wcs": wcs, "frame_class": EllipticalFrame}
    axes: Any
    if ax is None:
        axes = plt.figure(figsize=(WIDTH, (0.6 if is_whole else 0.92) * WIDTH + below)).add_subplot(**options)
    elif ax.get_subplotspec() is not None:
        axes = ax.figure.add_subplot(ax.get_subplotspec(), **options)
        ax.remove()
    else:
        axes = ax.figure.add_axes(ax.get_position().bounds, **options)
        ax.remove()
    axes.sky_frame, axes.projection_name, axes.centre = frame, projection, centre
    height, width = wcs.array_shape
    axes.set(xlim=(-0.5, width - 0.5), ylim=(-0.5, height - 0.5), aspect="equal")
    for coordinate in axes.coords:
        coordinate.set_ticks_visible(False)
        coordinate.set_ticklabel_visible(False)
        coordinate.set_axislabel("")
    axes.coords.frame.set_linewidth(0.6)
    _draw_graticule(axes)
    names = ANGLES[frame]
    label = f"{title_of(frame)}: {names[0]} ←, {names[1]} ↑"
    axes.text(1.0, 0.0, label, transform=axes.transAxes, ha="right", va="bottom", fontsize=_SIZE, color="0.35")
    return axes


def _resolve_centre(centre, projection):
    if centre is None:
        centre = (0.0, 90.0) if projection == "polar" else (0.0, 0.0)
    try:
        lon, lat = (float(coordinate) for coordinate in centre)
    except (TypeError, ValueError):
        lon = lat = np.nan
    if not (np.isfinite(lon) and abs(lat) <= 90):
        raise ParameterError(f"centre is a longitude and a latitude in degrees, not {centre!r}")
    # Just off a pole, north is up as it is all around it.
    return lon % 360, float(np.clip(lat, -90 + 1e-6, 90 - 1e-6))


def _make_wcs(frame, projection, centre):
    code, radius = PROJECTIONS[projection]
    height = _WIDTH_IN_PIXELS // 2
    width = _WIDTH_IN_PIXELS if projection in _WHOLE_SKY else height
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = [f"{axis}-{code}" for axis in _AXIS_CODES[frame]]
    scale = 2 * np.degrees(radius) / width
    wcs.wcs.cdelt, wcs.wcs.crpix, wcs.wcs.crval = [-scale, scale], [width / 2 + 0.5, height / 2 + 0.5], list(centre)
    if projection in _WHOLE_SKY:
        wcs.wcs.lonpole = 0.0 if centre[1] >= 0 else 180.0  # north up
    wcs.array_shape = (height, width)
    wcs.wcs.set()
    return wcs


def project_curve(axes: SkyAxes, lon: FloatArray, lat: FloatArray) -> FloatArray:
    """A curve on the sky as points on the map, with gaps of NaN where it goes over the seam."""
    xy, native_lon = axes.project(lon, lat)
    if not axes.is_whole:
        return xy
    crossings = np.flatnonzero(np.abs(np.diff(native_lon)) > 180) + 1
    return np.insert(xy, crossings, np.nan, axis=0)


def _draw_graticule(axes):
    line_style = {"color": "0.82", "linewidth": 0.4, "zorder": 1}
    latitudes, longitudes = np.radians(np.linspace(-90, 90, 181)), np.radians(np.linspace(0, 360, 721))
    for lon in range(0, 360, 30):
        axes.plot(*project_curve(axes, np.full(181, np.radians(lon)), latitudes).T, **line_style)
    for lat in range(-60, 61, 30):
        axes.plot(*project_curve(axes, longitudes, np.full(721, np.radians(lat))).T, **line_style)
    # About a pole the equator is the rim: longitudes stand inside it.
    label_lat = 0.0
    if not axes.is_whole and abs(axes.centre[1]) >= 60:
        label_lat = np.copysign(20.0 if axes.projection_name == "polar" else 42.0, axes.centre[1])
    labels = [(lon, label_lat, f"{lon}°") for lon in range(0, 360, 60)]
    has_even_rim = axes.is_whole and abs(axes.centre[1]) < 1e-3
    for lat in (30, -30, 60, -60):
        text = f"{lat:+d}°".replace("-", "−")
        if has_even_rim:  # beside the map, where they hide nothing
            (x, y), _ = axes.project(np.radians(axes.centre[0] + 179.999), np.radians(lat))
            axes.text(x - 0.6 * _POINT * _SIZE, y, text, ha="right", va="center", **_LABEL_STYLE | {"gid": "rim"})
        else:
            labels.append((axes.centre[0], lat, text))
    boxes: list[tuple[float, float, float]] = []
    xy, native = axes.project(*np.radians([[lon, lat] for lon, lat, _ in labels]).T)
    for (x, y), native_lon, (_, _, text) in zip(xy, native, labels, strict=True):
        half_text = 0.34 * _SIZE * _POINT * len(text)
        # Outside the limb, or half over it.
        if not np.isfinite(x) or (axes.is_whole and abs(native_lon) > 179) or not _is_inside(axes, x, y, half_text):
            continue
        if any(abs(x - at) < half_text + box_half and abs(y - up) < 1.2 * _SIZE * _POINT for at, up, box_half in boxes):
            continue
        boxes.append((x, y, half_text))
        axes.text(x, y, text, ha="center", va="center", path_effects=HALO, **_LABEL_STYLE)


def _is_inside(axes, x, y, half_width):
    """Return whether a label is within the map's ellipse."""
    height, width = axes.wcs.array_shape
    reach = max(abs(x - half_width - width / 2), abs(x + half_width - width / 2)) / (width / 2)
    return reach**2 + ((abs(y - height / 2) + 0.5 * _SIZE * _POINT) / (height / 2)) ** 2 < 1


#: A cone as wide as this says nothing of where a vector points. [deg]
_WIDEST_CONE = 80.0
#: Nor does a vector that noise alone gives as often as this; reports say that its direction is not determined.
_MAX_P_VALUE = 0.05


def draw_sources(axes: SkyAxes, lon: FloatArray, lat: FloatArray, *, max_sources: int = 20_000, **style: Any) -> Any:
    """Sources as small dots; the more, the thinner; every k-th of more than `max_sources`.

    Parameters
    ----------
    axes : SkyAxes
        Where to draw.
    lon, lat : (n,) arrays
        Positions. [rad]
    max_sources : int
        Beyond which only every k-th is drawn.
    **style
        Style of the dots, as for `matplotlib.axes.Axes.scatter`.
    """
    step = -(-len(lon) // max_sources) or 1
    n = max(1, len(lon) // step)
    density_style = {"s": float(np.clip(400 / n, 0.25, 2.0)), "alpha": float(np.clip(4000 / n, 0.3, 0.85))}
    # In a PDF thousands of dots are a picture, and text and arrows stay lines.
    style = {"color": "0.62", "linewidths": 0, "zorder": 2, "rasterized": n > 2000} | density_style | style
    return axes.scatter(*axes.project(lon[::step], lat[::step])[0].T, **style)


def draw_points(axes: SkyAxes, lon: ArrayLike, lat: ArrayLike, **style: Any) -> Any:
    """Places as marks.

    Parameters
    ----------
    axes : SkyAxes
        Where to draw.
    lon, lat : (n,) arrays
        Positions. [rad]
    **style
        Style of the marks, as for `matplotlib.axes.Axes.scatter`.
    """
    return axes.scatter(*axes.project(np.atleast_1d(lon), np.atleast_1d(lat))[0].T, **({"zorder": 6} | style))


def draw_line(axes: SkyAxes, lon: FloatArray, lat: FloatArray, **style: Any) -> Any:
    """A curve on the sky, cut at the seam."""
    return axes.plot(*project_curve(axes, lon, lat).T, **({"zorder": 5} | style))[0]


def draw_direction(
    axes: SkyAxes, vector: Vector, label: str, color: str = "#d55e00", *, probability: float = 0.68
) -> Any:
    """Mark the direction of a vector with its cone of confidence; nothing where it is not known.

    Parameters
    ----------
    axes : SkyAxes
        Where to draw, in the vector's frame.
    vector : Vector
        With its covariance.
    label : str
        In a legend.
    color : str
        Colour of star and cone.
    probability : float
        Probability of the cone.
    """
    lon, lat = np.radians(vector.direction)
    cone = vector.direction_cone(probability)
    if cone > _WIDEST_CONE or vector.p_value > _MAX_P_VALUE:
        return axes.scatter([], [], marker="*", s=0, color=color, label=f"{label}: direction not known")
    if cone > 0:
        p, q, r = triad(lon, lat)
        angle = np.linspace(0, 2 * np.pi, 361)
        tangent = np.multiply.outer(p, np.cos(angle)) + np.multiply.outer(q, np.sin(angle))
        circle = np.cos(np.radians(cone)) * r[:, None] + np.sin(np.radians(cone)) * tangent
        draw_line(axes, *angles(circle), color=color, linewidth=1.1, path_effects=HALO)
        label = f"{label}, {100 * probability:.0f} % within {cone:.{0 if cone >= 3 else 1}f}°"
    return draw_points(
        axes, lon, lat, marker="*", s=42, color=color, edgecolor="white", linewidths=0.4, zorder=7, label=label
    )


#: So many rows have a name each, and so many a number in each cell.
NAMED, NUMBERED = 20, 8


def draw_matrix(axes: Axes, matrix: FloatArray, names: Sequence[str], groups: Sequence[str] | None = None) -> Any:
    """Correlations as colours about zero, with their values where there is room; the diagonal left out."""
    k = len(names)
    off_diagonal = np.where(np.eye(k) > 0, np.nan, matrix)
    reach = max(float(np.nanmax(np.abs(off_diagonal))) if k > 1 else 0.0, 0.2)  # less has no strong colour
    axes.set_facecolor("0.85")
    image = axes.imshow(off_diagonal, cmap=DIVERGING, vmin=-reach, vmax=reach)
    axes.spines[["top", "right"]].set_visible(True)
    axes.tick_params(length=0)
    groups = groups or ()
    group_starts = [i for i, group in enumerate(groups) if i == 0 or group != groups[i - 1]]
    for i in group_starts[1:]:
        heavy = groups[i][:1] != groups[i - 1][:1]
        for draw in (axes.axhline, axes.axvline):
            draw(i - 0.5, color="0.4" if heavy else "0.6", linewidth=0.8 if heavy else 0.25 if k <= 60 else 0.1)
    if k > NAMED and group_starts:
        middles = [(start + end - 1) / 2 for start, end in pairwise([*group_starts, k])]
        labels = [groups[i] for i in group_starts]
        # The first of each kind, degree 1, and of the others those that do not lie on the one before.
        shown: list[int] = []
        for i, middle in enumerate(middles):
            if not shown or labels[i][:1] != labels[shown[-1]][:1] or middle - middles[shown[-1]] > k / 24:
                shown.append(i)
        axes.set_xticks([middles[i] for i in shown], [labels[i] for i in shown])
        axes.set_yticks([middles[i] for i in shown], [labels[i] for i in shown])
    else:
        step = max(1, k // NAMED)
        size = 8 if k <= 9 else 6 if k <= 20 else 4.5
        axes.set_xticks(range(0, k, step), list(names)[::step], rotation=0 if k <= 9 else 90, fontsize=size)
        axes.set_yticks(range(0, k, step), list(names)[::step], fontsize=size)
    if k <= NUMBERED:
        for (row, column), value in np.ndenumerate(off_diagonal):
            if np.isfinite(value):
                text = "0.00" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")
                colour = "w" if abs(value) > 0.6 * reach else "k"
                axes.text(column, row, text, ha="center", va="center", fontsize=6.5, color=colour)
    return image


def draw_map(axes: SkyAxes, values: ArrayLike, cmap: str = SEQUENTIAL, **style: Any) -> Any:
    """A HEALPix map (ring order) on a map of the sky; empty pixels (NaN) stay blank.

    Parameters
    ----------
    axes : SkyAxes
        Where to draw.
    values : (12 nside²,) array
        In ring order, in the frame of the axes.
    cmap : str
        The colours.
    **style
        Style of the image.
    """
    values = np.asarray(values, float)
    height, width = axes.wcs.array_shape
    y, x = np.mgrid[0:height, 0:width]
    lon, lat = axes.sky_of(x.ravel(), y.ravel())
    is_on_map = np.isfinite(lon)
    picture = np.full(lon.size, np.nan)
    picture[is_on_map] = values[pixels_of(lon[is_on_map], lat[is_on_map], int(np.sqrt(values.size / 12)))]
    style = {"zorder": 0.5, "interpolation": "nearest", "rasterized": True, "origin": "lower"} | style
    return axes.imshow(picture.reshape(height, width), cmap=cmap, **style)


@apply_style
def plot_map(
    values: ArrayLike,
    label: str,
    *,
    frame: str = "icrs",
    cmap: str = SEQUENTIAL,
    title: str | None = None,
    ax: Axes | None = None,
    extend: str = "neither",
    **style: Any,
) -> SkyAxes:
    """A HEALPix map on the sky with its colour bar; what has no value is grey.

    Parameters
    ----------
    values : (12 nside²,) array
        In ring order; NaN where there is no value.
    label : str
        Under the colour bar.
    frame : str
        Axes of the map.
    cmap : str
        The colours.
    title : str, optional
        Above.
    ax : matplotlib Axes, optional
        Axes whose place the map takes; a new figure unless given.
    extend : {"neither", "both", "min", "max"}
        Where values lie beyond the colours.
    **style
        Style of the image: `vmin`, `vmax`.
    """
    n_extra_lines = (title or "").count("\n") + label.count("\n")
    axes = sky_axes(frame, ax, below=0.45 + 0.14 * n_extra_lines)
    if np.isnan(np.asarray(values, float)).any():
        axes.set_facecolor("0.87")
    colour_bar(axes, draw_map(axes, values, cmap, **style), label, extend=extend)
    if title:
        axes.set_title(title)
    return axes


def draw_empty(axes: SkyAxes, lon: FloatArray, lat: FloatArray, radius: float | None = None) -> Any:
    """Hatch where no source stands within a radius."""
    if not len(lon):
        return None
    # e^−x² of all places are farther than x times the radius of a source's share of the sky.
    radius = radius or max(2.0, 2.5 * np.degrees(np.sqrt(4 / len(lon))))
    height, width = axes.wcs.array_shape
    y, x = np.mgrid[0:height:4, 0:width:4]
    positions = np.stack(axes.sky_of(x.ravel(), y.ravel()))
    is_on_map = np.isfinite(positions).all(0)
    distance = np.zeros(positions.shape[1])
    distance[is_on_map] = cKDTree(triad(lon, lat)[2].T).query(triad(*positions[:, is_on_map])[2].T)[0]
    chord = 2 * np.sin(np.radians(radius) / 2)
    if not (distance > chord).any():
        return None
    contours = axes.contourf(
        x, y, distance.reshape(x.shape), levels=[chord, 3.0], colors="none", hatches=["//////"], zorder=0.6
    )
    contours.set_edgecolor("0.55")
    contours.set_linewidth(0.0)
    return contours
