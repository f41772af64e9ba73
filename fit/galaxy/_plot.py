"""An acceleration in the Galaxy (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from fit.galaxy._relations import expected_acceleration
from vsh.types import Figure


def plot_orbit(found: Any) -> Figure:
    """The three components with their errors, and the acceleration of a circular orbit.

    Parameters
    ----------
    found : GalacticOrbit
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
    axes.errorbar(
        range(3), found.acceleration.value, found.acceleration.sigma, fmt="o", capsize=4, color="#0b5394", label="found"
    )
    expected = expected_acceleration(found.r0)
    axes.scatter(
        range(3),
        [expected, 0, 0],
        marker="_",
        s=900,
        color="#c55a11",
        label="circular orbit, Sgr A*'s motion",
        zorder=1,
    )
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set_xlim(-0.5, 2.5)
    axes.set_xticks(range(3), ["towards the\ncentre", "along\nrotation", "towards the\nnorth pole"])
    axes.set_ylabel("acceleration ã  [µas/yr]", fontsize=13)
    axes.tick_params(labelsize=12)
    axes.legend(frameon=False, fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
