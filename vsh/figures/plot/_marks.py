"""Points, curves and directions on a map of the sky."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from vsh.figures.plot._sky_axes import HALO, SkyAxes, lines_on
from vsh.figures.plot._style import DIVERGING
from vsh.sky.sphere import angles, triad
from vsh.tools.types import ArrayLike, Axes, FloatArray
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
        Style of the dots, as for `matplotlib.axes.Axes.scatter`.
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
        Style of the marks, as for `matplotlib.axes.Axes.scatter`.
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
        Colour of star and cone.
    probability : float
        Probability of the cone.
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
    return draw_points(
        axes, lon, lat, marker="*", s=42, color=color, edgecolor="white", linewidths=0.4, zorder=7, label=label
    )


#: So many rows have a name each, and so many a number in each cell.
NAMED, NUMBERED = 30, 8
_LETTERS = {"epsilon_": r"\epsilon", "omega_": r"\omega", "a_": r"\tilde a", "v_": "v"}


#: The name of a coefficient: kind, degree, order, and real or imaginary part.
_MODE = re.compile(r"([tsf])\((\d+),(\d+)(?:,(re|im))?\)")


def symbol(name: str) -> str:
    """A parameter's name as it is written: ω_x, ã_x, t_20, s_21^R."""
    mode = _MODE.fullmatch(name)
    if mode:
        kind, l, m, part = mode.groups()
        low = f"{l}{m}" if len(l) == len(m) == 1 else f"{l},{m}"
        return f"${kind}_{{{low}}}^{{\\rm {'R' if part == 're' else 'I'}}}$" if part else f"${kind}_{{{low}}}$"
    for plain, letter in _LETTERS.items():
        if name.startswith(plain):
            return f"${letter}_{name[len(plain) :]}$"
    return name


def draw_matrix(axes: Axes, matrix: FloatArray, names: Sequence[str], groups: Sequence[str] | None = None) -> Any:
    """Correlations as colours about zero, with their values where there is room; the diagonal left out."""
    k = len(names)
    off = np.where(np.eye(k) > 0, np.nan, matrix)
    reach = max(float(np.nanmax(np.abs(off))) if k > 1 else 0.0, 1e-3)
    axes.set_facecolor("0.85")
    image = axes.imshow(off, cmap=DIVERGING, vmin=-reach, vmax=reach)
    axes.spines[["top", "right"]].set_visible(True)
    axes.tick_params(length=0)
    if groups is not None and len(set(groups)) > 1:
        first = [i for i in range(k) if i == 0 or groups[i] != groups[i - 1]]
        for i in first[1:]:
            heavy = groups[i][:1] != groups[i - 1][:1]
            for line in (axes.axhline, axes.axvline):
                line(i - 0.5, color="0.4" if heavy else "0.6", linewidth=0.8 if heavy else 0.25 if k <= 60 else 0.1)
    if k > NAMED and groups is not None:
        ends = [*first, k]
        middles = [(a + b - 1) / 2 for a, b in pairwise(ends)]
        words = [groups[i] for i in first]
        # The narrow ones of the lowest degrees would lie on each other.
        shown = [i for i, (a, b) in enumerate(pairwise(ends)) if b - a > k / 22]
        axes.set_xticks([middles[i] for i in shown], [words[i] for i in shown])
        axes.set_yticks([middles[i] for i in shown], [words[i] for i in shown])
    else:
        every = max(1, k // NAMED)
        size = 8 if k <= 9 else 6 if k <= 20 else 4.5
        axes.set_xticks(range(0, k, every), list(names)[::every], rotation=0 if k <= 9 else 90, fontsize=size)
        axes.set_yticks(range(0, k, every), list(names)[::every], fontsize=size)
    if k <= NUMBERED:
        for (row, column), value in np.ndenumerate(off):
            if np.isfinite(value):
                white = abs(value) > 0.6 * reach
                axes.text(
                    column,
                    row,
                    f"{value:+.2f}".replace("-", "−"),
                    ha="center",
                    va="center",
                    fontsize=6.5,
                    color="w" if white else "k",
                )
    return image
