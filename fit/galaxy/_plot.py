"""An acceleration in the Galaxy (matplotlib)."""

from typing import Any

from fit.galaxy._relations import expected_acceleration
from vsh.figures.plot import COLOURS, legend_above, panels, styled
from vsh.tools.types import Axes


@styled
def plot_orbit(galactic_orbit: Any, *, ax: Axes | None = None) -> Axes:
    """The three components with their errors, and the acceleration of a circular orbit."""
    (axes,) = panels(ax)
    axes.errorbar(
        range(3),
        galactic_orbit.acceleration.value,
        galactic_orbit.acceleration.sigma,
        fmt="o",
        color=COLOURS[0],
        label="found",
    )
    expected = [expected_acceleration(galactic_orbit.r0), 0, 0]
    axes.scatter(
        range(3), expected, marker="_", s=400, color=COLOURS[1], label="circular orbit, motion of Sgr A*", zorder=1
    )
    axes.axhline(0, color="0.6", linewidth=0.6)
    axes.set_xlim(-0.5, 2.5)
    axes.set_xticks(range(3), ["towards the\ncentre", "along\nrotation", "towards the\nnorth pole"])
    axes.set_ylabel("acceleration ã  [µas/yr]")
    legend_above(axes)
    return axes
