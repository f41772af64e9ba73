"""Axes that show the sky: any projection, any centre, a graticule of our own (astropy's WCSAxes)."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from astropy.visualization.wcsaxes import WCSAxes
from astropy.visualization.wcsaxes.frame import EllipticalFrame
from astropy.wcs import WCS
from matplotlib.patheffects import withStroke

from vsh.figures.plot._style import WIDTH, styled
from vsh.sky.frames import ANGLES, check_frame
from vsh.tools.arguments import choice
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, Axes, FloatArray

#: FITS's names of the projections (Calabretta & Greisen 2002), and the radius of each along the abscissa. [rad]
PROJECTIONS = {
    "hammer": ("AIT", 2 * np.sqrt(2)),
    "mollweide": ("MOL", 2 * np.sqrt(2)),
    "globe": ("SIN", 1.0),
    "polar": ("ZEA", np.sqrt(2)),
}
_WHOLE = ("hammer", "mollweide")
_AXES = {"icrs": ("RA--", "DEC-"), "galactic": ("GLON", "GLAT"), "ecliptic": ("ELON", "ELAT")}
#: Width of the map in pixels, in which everything is drawn.
_WIDE = 1000
#: A point of type is so many pixels of a whole sky that is 9 cm wide.
_POINT = _WIDE / (WIDTH * 72)
_SIZE = 6.0
HALO = [withStroke(linewidth=1.6, foreground="white")]


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
        """Whether all of the sky is shown, and not the half about the centre."""
        return self.projection_name in _WHOLE

    def project(self, lon: ArrayLike, lat: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Positions on the map, and their longitude from its central meridian, for `lon`, `lat` of one shape. [rad]

        Returns
        -------
        xy : (…, 2) array
            In the map's pixels; NaN where not shown.
        native : (…) array
            Longitude about the map's own pole, −180 to 180: the seam of a whole sky is where it jumps. [deg]
        """
        lon, lat = np.broadcast_arrays(np.degrees(lon), np.degrees(lat))
        if lon.size == 0:
            return np.zeros((*lon.shape, 2)), np.zeros(lon.shape)
        projected = self.wcs.wcs.s2p(np.stack([lon.ravel(), lat.ravel()], axis=1), 0)
        xy, native = projected["pixcrd"].copy(), projected["phi"].copy()
        hidden = np.asarray(projected["stat"]) != 0
        if not self.is_whole:
            hidden |= projected["theta"] < 0
        xy[hidden] = np.nan
        return xy.reshape(*lon.shape, 2), native.reshape(lon.shape)

    def sky_of(self, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Where on the sky the pixels `x`, `y` of the map are, (n,).

        Returns
        -------
        lon, lat : (n,) arrays
            Positions, NaN off the map. [rad]
        """
        with np.errstate(invalid="ignore"):
            lon, lat = np.radians(self.wcs.wcs_pix2world(np.stack([x, y], axis=1), 0)).T
        return lon, lat

    def of_native(self, phi: ArrayLike, theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Where on the sky a place of the map's own coordinates is.

        Parameters
        ----------
        phi, theta : (n,) arrays
            Longitude and latitude about the map's own pole, as if nothing were turned. [rad]

        Returns
        -------
        lon, lat : (n,) arrays
            Positions. [rad]
        """
        upright = _wcs(self.sky_frame, self.projection_name, (0.0, 0.0 if self.is_whole else 90.0))
        if not self.is_whole:
            upright.wcs.lonpole = 0.0
            upright.wcs.set()
        x, y = upright.wcs_world2pix(np.degrees(np.stack([phi, theta], axis=1)), 0).T
        return self.sky_of(x, y)


@styled
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
    centre = _centre(centre, projection)
    wcs = _wcs(frame, projection, centre)
    whole = projection in _WHOLE
    how: dict[str, Any] = {"axes_class": SkyAxes, "wcs": wcs, "frame_class": EllipticalFrame}
    made: Any
    if ax is None:
        made = plt.figure(figsize=(WIDTH, (0.6 if whole else 0.92) * WIDTH + below)).add_subplot(**how)
    elif ax.get_subplotspec() is not None:
        made = ax.figure.add_subplot(ax.get_subplotspec(), **how)
        ax.remove()
    else:
        made = ax.figure.add_axes(ax.get_position().bounds, **how)
        ax.remove()
    made.sky_frame, made.projection_name, made.centre = frame, projection, centre
    high, wide = wcs.array_shape
    made.set(xlim=(-0.5, wide - 0.5), ylim=(-0.5, high - 0.5), aspect="equal")
    for coordinate in made.coords:
        coordinate.set_ticks_visible(False)
        coordinate.set_ticklabel_visible(False)
        coordinate.set_axislabel("")
    made.coords.frame.set_linewidth(0.6)
    _graticule(made)
    names = ANGLES[frame]
    label = f"{'ICRS' if frame == 'icrs' else frame}: {names[0]} ←, {names[1]} ↑"
    made.text(1.0, 0.0, label, transform=made.transAxes, ha="right", va="bottom", fontsize=_SIZE, color="0.35")
    return made


def _centre(centre, projection):
    if centre is None:
        centre = (0.0, 90.0) if projection == "polar" else (0.0, 0.0)
    try:
        lon, lat = (float(each) for each in centre)
    except (TypeError, ValueError):
        lon = lat = np.nan
    if not (np.isfinite(lon) and abs(lat) <= 90):
        raise ParameterError(f"centre is a longitude and a latitude in degrees, not {centre!r}")
    # Just off a pole, north is up as it is all around it.
    return lon % 360, float(np.clip(lat, -90 + 1e-6, 90 - 1e-6))


def _wcs(frame, projection, centre):
    code, radius = PROJECTIONS[projection]
    high = _WIDE // 2
    wide = _WIDE if projection in _WHOLE else high
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = [f"{axis}-{code}" for axis in _AXES[frame]]
    step = 2 * np.degrees(radius) / wide
    wcs.wcs.cdelt, wcs.wcs.crpix, wcs.wcs.crval = [-step, step], [wide / 2 + 0.5, high / 2 + 0.5], list(centre)
    if projection in _WHOLE:
        wcs.wcs.lonpole = 0.0 if centre[1] >= 0 else 180.0  # north up
    wcs.array_shape = (high, wide)
    wcs.wcs.set()
    return wcs


def lines_on(axes: SkyAxes, lon: FloatArray, lat: FloatArray) -> FloatArray:
    """A curve on the sky as points on the map, with gaps of NaN where it goes over the seam."""
    xy, native = axes.project(lon, lat)
    if not axes.is_whole:
        return xy
    over = np.flatnonzero(np.abs(np.diff(native)) > 180) + 1
    return np.insert(xy, over, np.nan, axis=0)


def _graticule(axes):
    style = {"color": "0.82", "linewidth": 0.4, "zorder": 1}
    along, around = np.radians(np.linspace(-90, 90, 181)), np.radians(np.linspace(0, 360, 721))
    for lon in range(0, 360, 30):
        axes.plot(*lines_on(axes, np.full(181, np.radians(lon)), along).T, **style)
    for lat in range(-60, 61, 30):
        axes.plot(*lines_on(axes, around, np.full(721, np.radians(lat))).T, **style)
    # About a pole the equator is the rim: longitudes stand inside it.
    at = (
        0.0
        if axes.is_whole or abs(axes.centre[1]) < 60
        else np.copysign(20.0 if axes.projection_name == "polar" else 42.0, axes.centre[1])
    )
    wanted = [(lon, at, f"{lon}°") for lon in range(0, 360, 60)]
    wanted += [(axes.centre[0], lat, f"{lat:+d}°".replace("-", "−")) for lat in (30, -30, 60, -60)]
    taken: list[tuple[float, float, float]] = []
    xy, native = axes.project(*np.radians([[lon, lat] for lon, lat, _ in wanted]).T)
    for (x, y), from_middle, (_, _, words) in zip(xy, native, wanted, strict=True):
        half = 0.34 * _SIZE * _POINT * len(words)
        # Outside the limb, or half over it.
        if not np.isfinite(x) or (axes.is_whole and abs(from_middle) > 179) or not _inside(axes, x, y, half):
            continue
        if any(abs(x - at) < half + other and abs(y - up) < 1.2 * _SIZE * _POINT for at, up, other in taken):
            continue
        taken.append((x, y, half))
        axes.text(
            x,
            y,
            words,
            ha="center",
            va="center",
            fontsize=_SIZE,
            color="0.25",
            path_effects=HALO,
            zorder=9,
            gid="graticule",
        )


def _inside(axes, x, y, half):
    """Whether a label is within the map's ellipse."""
    high, wide = axes.wcs.array_shape
    reach = max(abs(x - half - wide / 2), abs(x + half - wide / 2)) / (wide / 2)
    return reach**2 + ((abs(y - high / 2) + 0.5 * _SIZE * _POINT) / (high / 2)) ** 2 < 1
