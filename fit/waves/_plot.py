"""Maps of a search for a wave (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fit.quality import printed_p_value
from vsh.sky.plot import draw_map, on_map, sky_axes
from vsh.types import Figure


def plot_search(found: Any) -> Figure:
    """2F and the limit of every direction that a wave may travel to.

    Parameters
    ----------
    found : WaveSearch
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure = plt.figure(figsize=(8, 9), layout="constrained")
    lon, lat = np.radians(found.direction)
    for place, values, label, cmap in (
        (1, found.statistic, "2F of a wave that travels there", "viridis"),
        (2, found.limits, f"95 % limit on its amplitude  [{found.unit}]", "cividis"),
    ):
        axes = sky_axes(found.frame, figure.add_subplot(2, 1, place, projection="hammer"))
        image = draw_map(axes, values, cmap=cmap)
        bar = figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
        bar.set_label(label, fontsize=12)
        axes.scatter(on_map(lon), lat, marker="+", s=120, color="#c55a11", zorder=4)
        if place == 1:
            axes.set_title(
                f"largest 2F = {found.statistic.max():.1f}; p = {printed_p_value(found.p_value)} with all directions looked at",
                pad=16, fontsize=12,
            )  # fmt: skip
    return figure
