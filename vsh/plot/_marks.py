"""Points, curves and directions on a map of the sky."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.checks.types import ArrayLike, FloatArray
from vsh.plot._sky_axes import HALO, SkyAxes, lines_on
from vsh.sky.sphere import angles, triad
from vsh.vector import Vector

#: A cone as wide as this says nothing of where a vector points. [deg]
_LOST = 80.0
#: Nor does a vector that noise alone gives as often as this; reports say that its direction is not determined.
_CHANCE = 0.05


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
        Of the dots, as for `matplotlib.axes.Axes.scatter`.
    """
    step = -(-len(lon) // max_sources) or 1
    n = max(1, len(lon) // step)
    thin = {"s": float(np.clip(400 / n, 0.25, 2.0)), "alpha": float(np.clip(4000 / n, 0.3, 0.85))}
    # In a PDF thousands of dots are a picture, and text and arrows stay lines.
    style = {"color": "0.55", "linewidths": 0, "zorder": 2, "rasterized": n > 2000} | thin | style
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
        Of the marks, as for `matplotlib.axes.Axes.scatter`.
    """
    return axes.scatter(*axes.project(np.atleast_1d(lon), np.atleast_1d(lat))[0].T, **({"zorder": 6} | style))


def draw_line(axes: SkyAxes, lon: FloatArray, lat: FloatArray, **style: Any) -> Any:
    """A curve on the sky, cut at the seam."""
    return axes.plot(*lines_on(axes, lon, lat).T, **({"zorder": 5} | style))[0]


def draw_direction(
    axes: SkyAxes, vector: Vector, label: str, color: str = "#d55e00", *, probability: float = 0.68
) -> Any:
    """Where a vector points, and the cone that holds its true direction; nothing where that is not known.

    Parameters
    ----------
    axes : SkyAxes
        Where to draw, in the vector's frame.
    vector : Vector
        With its covariance.
    label : str
        In a legend.
    color : str
        Of star and cone.
    probability : float
        Of the cone.
    """
    lon, lat = np.radians(vector.direction)
    known = bool(np.any(vector.covariance))
    cone = vector.direction_cone(probability) if known else 0.0
    if cone > _LOST or vector.p_value > _CHANCE:
        return axes.scatter([], [], marker="*", s=0, color=color, label=f"{label}: direction not known")
    if cone > 0:
        p, q, r = triad(lon, lat)
        t = np.linspace(0, 2 * np.pi, 361)
        side = np.multiply.outer(p, np.cos(t)) + np.multiply.outer(q, np.sin(t))
        circle = np.cos(np.radians(cone)) * r[:, None] + np.sin(np.radians(cone)) * side
        draw_line(axes, *angles(circle), color=color, linewidth=1.1, path_effects=HALO)
        label = f"{label}, {100 * probability:.0f} % within {cone:.{0 if cone >= 3 else 1}f}°"
    return draw_points(axes, lon, lat, marker="*", s=42, color=color, edgecolor="white", linewidths=0.4, zorder=7, label=label)  # fmt: skip
