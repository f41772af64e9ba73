"""Maps of a search for a wave (matplotlib)."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.quality import printed_p_value
from vsh.plot import COLOURS, WIDTH, draw_points, panels, plot_map, styled


@styled
def plot_search(found: Any, *, ax: Any = None) -> Any:
    """2F and the limit of every direction that a wave may travel to.

    Parameters
    ----------
    found : WaveSearch
        What to draw.
    ax : two matplotlib axes, optional
        Whose places the maps take; a new figure unless given.
    """
    said = (
        f"largest 2F = {found.statistic.max():.1f}; p = {printed_p_value(found.p_value)} with all directions looked at"
    )
    drawn = panels(ax, 2, 1, size=(WIDTH, 5.2))
    for place, values, label, cmap, title in (
        (0, found.statistic, "2F of a wave that travels there", "viridis", said),
        (1, found.limits, f"95 % limit on its amplitude  [{found.unit}]", "cividis", None),
    ):
        drawn[place] = plot_map(values, label, frame=found.frame, cmap=cmap, title=title, ax=drawn[place])
        draw_points(drawn[place], *np.radians(found.direction), marker="+", s=60, color=COLOURS[1])
    return drawn
