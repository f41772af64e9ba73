"""An expansion on the sky (matplotlib)."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.shear._tensor import coefficients_of
from vsh.sky.plot import draw_vectors, even_grid, on_map, sky_axes
from vsh.sky.sphere import angles
from vsh.types import Figure


def plot_shear(found: Any) -> Figure:
    """The motions of the fitted expansion, and where its principal axes point.

    Parameters
    ----------
    found : Shear
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    axes = sky_axes(found.frame)
    lon, lat = even_grid()
    motion = coefficients_of(found.tensor).at(lon, lat)
    draw_vectors(axes, lon, lat, motion, color="0.45")
    rates = zip(found.eigenvalues, found.eigenvalue_errors, found.axes, ("#0b5394", "0.35", "#c55a11"), strict=True)
    for rate, error, axis, colour in rates:
        for sign in (1, -1):
            there, up = angles(sign * axis)
            label = f"{rate:+.2f} ± {error:.2f} µas/yr" if sign == 1 else None
            axes.scatter(on_map(there), up, s=160, color=colour, edgecolor="white", zorder=4, label=label)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, frameon=False, fontsize=11, title="rate along the axis"
    )
    largest = np.hypot(*motion).max()
    axes.set_title(f"expansion of degree 2: motions to {largest:.2g} µas/yr", pad=16)
    return axes.figure
