"""Figures of an acceleration in the Galaxy, and of an expansion on the sky (matplotlib)."""

from typing import Any

import numpy as np

from vsh.coefficients import Coefficients
from vsh.figures.plot import (
    COLOURS,
    SkyAxes,
    apply_style,
    arrow_grid,
    draw_points,
    draw_vectors,
    legend_above,
    panels,
    sky_axes,
)
from vsh.sky.sphere import angles
from vsh.tools.digits import format_with_error
from vsh.tools.types import Axes

#: The components xx, yy, zz, xy, xz, yz by how often they stand in a symmetric tensor.
_MULTIPLICITY = np.diag([1, 1, 1, 2, 2, 2])


@apply_style
def plot_orbit(galactic_orbit: Any, circular_acceleration: float, *, ax: Axes | None = None) -> Axes:
    """The three components with their errors, and the acceleration of a circular orbit."""
    (axes,) = panels(ax)
    acceleration = galactic_orbit.acceleration
    axes.errorbar(range(3), acceleration.value, acceleration.sigma, fmt="o", color=COLOURS[0], label="found")
    axes.scatter(
        range(3),
        [circular_acceleration, 0, 0],
        marker="_",
        s=400,
        color=COLOURS[1],
        label="circular orbit, motion of Sgr A*",
        zorder=1,
    )
    axes.axhline(0, color="0.6", linewidth=0.6)
    axes.set_xticks(range(3), ["towards the\ncentre", "along\nrotation", "towards the\nnorth pole"])
    axes.set(xlim=(-0.5, 2.5), ylabel="acceleration ã  [µas/yr]")
    legend_above(axes)
    return axes


@apply_style
def plot_shear(tensor: Any, coefficients: Coefficients, *, ax: Axes | None = None) -> SkyAxes:
    """The motions of the fitted expansion, of these coefficients, and where its principal axes point."""
    axes = sky_axes(tensor.frame, ax, below=0.55)
    lon, lat = arrow_grid(axes)
    motion = coefficients.at(lon, lat)
    draw_vectors(axes, lon, lat, motion, color="0.45")
    colours = (COLOURS[0], "0.2", COLOURS[1])
    for rate, error, axis, colour in zip(
        tensor.eigenvalues, tensor.eigenvalue_errors, tensor.axes, colours, strict=True
    ):
        ends, label = angles(np.stack([axis, -axis], axis=1)), format_with_error(rate, error, "+")
        draw_points(axes, *ends, s=36, color=colour, edgecolor="white", label=label)
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.02),
        ncols=3,
        title="rate along the axis  [µas/yr]",
        title_fontsize=7,
    )
    axes.set_title(f"expansion of degree 2: motions to {np.hypot(*motion).max():.2g} µas/yr")
    return axes


@apply_style
def plot_shear_by_class(result: Any, *, ax: Axes | None = None) -> Axes:
    """The size of the tensor in each class, its limit, and what noise with systematic errors shows on average."""
    (axes,) = panels(ax)
    positions = np.arange(len(result))
    norms = [shear.norm for shear in result.shears]
    expected_norms = [np.sqrt(np.trace(shear.covariance * _MULTIPLICITY)) for shear in result.shears]
    axes.bar(positions, expected_norms, width=0.8, color="0.88", label="noise, expected")
    axes.plot(positions, norms, "o", color=COLOURS[0], label="estimate")
    limits = [shear.limit() for shear in result.shears]
    axes.plot(positions, limits, "v", color=COLOURS[1], markersize=4, label="95 % limit")
    axes.set_xticks(positions, result.labels, rotation=20)
    axes.set(ylim=(0, None), ylabel="|Σ|  [µas/yr]")
    legend_above(axes)
    return axes
