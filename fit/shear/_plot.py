"""An expansion on the sky (matplotlib)."""

from typing import Any

import numpy as np

from fit.shear._tensor import coefficients_of
from vsh.figures.plot import COLOURS, SkyAxes, arrow_grid, draw_points, draw_vectors, sky_axes, styled
from vsh.sky.sphere import angles
from vsh.tools.types import Axes


@styled
def plot_shear(tensor: Any, *, ax: Axes | None = None) -> SkyAxes:
    """The motions of the fitted expansion, and where its principal axes point."""
    axes = sky_axes(tensor.frame, ax, below=0.55)
    lon, lat = arrow_grid(axes)
    motion = coefficients_of(tensor.tensor).at(lon, lat)
    draw_vectors(axes, lon, lat, motion, color="0.45")
    colours = (COLOURS[0], "0.2", COLOURS[1])
    for rate, error, axis, colour in zip(
        tensor.eigenvalues, tensor.eigenvalue_errors, tensor.axes, colours, strict=True
    ):
        there, up = angles(np.stack([axis, -axis], axis=1))
        draw_points(axes, there, up, s=36, color=colour, edgecolor="white", label=f"{rate:+.2f} ± {error:.2f}")
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.02),
        ncols=3,
        title="rate along the axis  [µas/yr]",
        title_fontsize=7,
    )
    axes.set_title(f"expansion of degree 2: motions to {np.hypot(*motion).max():.2g} µas/yr")
    return axes
