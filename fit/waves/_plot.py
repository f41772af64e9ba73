"""Figures of a search: the map of directions, limits by frequency."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, draw_points, legend_above, panels, plot_map, set_log_ticks
from vsh.tools.digits import format_simulated_p_value
from vsh.tools.types import Axes, AxesArray, OnAxes


@apply_style
def plot_search(search: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """2F and the limit of every direction that a wave may travel to."""
    p_text = format_simulated_p_value(search.p_value, search.n_skies)
    heading = f"largest 2F = {search.statistic.max():.1f};\np-value {p_text} with all directions looked at"
    subplots = panels(ax, 2, 1, size=(WIDTH, 5.2))
    for panel, map_values, label, cmap, title in (
        (0, search.statistic, "2F of a wave that travels there", "viridis", heading),
        (1, search.limits, f"95 % limit on its amplitude  [{search.unit}]", "cividis", None),
    ):
        subplots[panel] = plot_map(map_values, label, frame=search.frame, cmap=cmap, title=title, ax=subplots[panel])
        draw_points(
            subplots[panel],
            *np.radians(search.direction),
            marker="+",
            s=60,
            color=COLOURS[1],
            label="likeliest direction",
        )
    legend_above(subplots[1])
    return subplots


@apply_style
def plot_spectrum(spectrum: Any, *, ax: Axes | None = None) -> Axes:
    """The strain that a wave can have, with 95 %, against its frequency: median and range over directions."""
    (axes,) = panels(ax, size=(WIDTH, 3.0))
    order = np.argsort(spectrum.frequencies)
    frequencies, limits = spectrum.frequencies[order], 1e9 * spectrum.strain_limits[order]
    is_dense = len(frequencies) > 2  # two frequencies say nothing of what lies between
    label = "range of directions"
    if is_dense:
        axes.fill_between(frequencies, limits[:, 0], limits[:, 2], color=COLOURS[0], alpha=0.25, lw=0, label=label)
    else:
        ends = np.abs(limits[:, [0, 2]] - limits[:, [1]]).T
        axes.errorbar(frequencies, limits[:, 1], ends, fmt="none", color=COLOURS[0], capsize=3, label=label)
        axes.set(xticks=frequencies)
        axes.margins(x=0.5)
    line_style = "o" if not is_dense else "o-" if len(frequencies) < 60 else "-"
    axes.plot(frequencies, limits[:, 1], line_style, ms=3, color=COLOURS[0], label="median direction")
    axes.set(yscale="log", xlabel="frequency  [1/yr]", ylabel="95 % limit on the strain  [10⁻⁹]")
    axes.margins(y=0.1)
    set_log_ticks(axes.yaxis, *axes.get_ylim())
    if frequencies[-1] > 5 * frequencies[0]:
        axes.set_xscale("log")
        set_log_ticks(axes.xaxis, frequencies[0], frequencies[-1])
    legend_above(axes, 2)
    return axes
