"""Maps of values, and where there is nothing."""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from vsh.figures.plot._sky_axes import SkyAxes, sky_axes
from vsh.figures.plot._style import SEQUENTIAL, colour_bar, styled
from vsh.sky.pixels import pixels_of
from vsh.sky.sphere import triad
from vsh.tools.types import ArrayLike, Axes, FloatArray


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
    high, wide = axes.wcs.array_shape
    y, x = np.mgrid[0:high, 0:wide]
    lon, lat = axes.sky_of(x.ravel(), y.ravel())
    shown = np.isfinite(lon)
    picture = np.full(lon.size, np.nan)
    picture[shown] = values[pixels_of(lon[shown], lat[shown], int(np.sqrt(values.size / 12)))]
    style = {"zorder": 0.5, "interpolation": "nearest", "rasterized": True, "origin": "lower"} | style
    return axes.imshow(picture.reshape(high, wide), cmap=cmap, **style)


@styled
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
    lines = (title or "").count("\n") + label.count("\n")
    axes = sky_axes(frame, ax, below=0.45 + 0.14 * lines)
    if np.isnan(np.asarray(values, float)).any():
        axes.set_facecolor("0.87")
    image = draw_map(axes, values, cmap, **style)
    colour_bar(axes, image, label, extend=extend)
    if title:
        axes.set_title(title)
    return axes


def draw_empty(axes: SkyAxes, lon: FloatArray, lat: FloatArray, radius: float | None = None) -> Any:
    """Hatch where no source stands within a radius."""
    if not len(lon):
        return None
    # e^−x² of all places are farther than x times the radius of a source's share of the sky.
    radius = radius or max(2.0, 2.5 * np.degrees(np.sqrt(4 / len(lon))))
    high, wide = axes.wcs.array_shape
    y, x = np.mgrid[0:high:4, 0:wide:4]
    at = np.stack(axes.sky_of(x.ravel(), y.ravel()))
    shown = np.isfinite(at).all(0)
    away = np.zeros(at.shape[1])
    away[shown] = cKDTree(triad(lon, lat)[2].T).query(triad(*at[:, shown])[2].T)[0]
    edge = 2 * np.sin(np.radians(radius) / 2)
    if not (away > edge).any():
        return None
    drawn = axes.contourf(
        x, y, away.reshape(x.shape), levels=[edge, 3.0], colors="none", hatches=["//////"], zorder=0.4
    )
    drawn.set_edgecolor("0.55")
    drawn.set_linewidth(0.0)
    return drawn
