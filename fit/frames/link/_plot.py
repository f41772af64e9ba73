"""Figures of links between frames."""

from itertools import pairwise
from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels, set_log_ticks
from vsh.tools.types import Axes, AxesArray, OnAxes


@apply_style
def plot_link(solution: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Orientation and spin against magnitude with standard errors, and influence and distance of each source."""
    vector_names = [vector for vector in ("orientation", "spin") if vector in solution.unknowns.vectors]
    panel_axes = panels(ax, len(vector_names) + 1, 1, size=(WIDTH, 2.2 * (len(vector_names) + 1)))
    magnitudes = solution.magnitude[np.isfinite(solution.magnitude)]
    lower, upper = (magnitudes.min() - 0.3, magnitudes.max() + 0.3) if magnitudes.size else (10.0, 20.0)
    segment_edges = [lower, *(step for step in sorted(solution.unknowns.steps) if lower < step < upper), upper]
    for axes, vector in zip(panel_axes, vector_names, strict=False):
        for k, axis in enumerate("xyz"):
            for start, end in pairwise(segment_edges):
                # A step belongs to what is fainter.
                grid = np.linspace(start, np.nextafter(end, -np.inf), 30)
                vectors_on_grid = [solution.vector(vector, float(magnitude)) for magnitude in grid]
                value = np.array([v.value[k] for v in vectors_on_grid])
                sigma = np.array([v.sigma[k] for v in vectors_on_grid])
                label = axis if start == segment_edges[0] else None
                axes.plot(grid, value, color=COLOURS[k], linestyle=("-", "--", "-.")[k], label=label)
                axes.fill_between(grid, value - sigma, value + sigma, color=COLOURS[k], alpha=0.15, linewidth=0)
        axes.axhline(0, color="0.6", lw=0.6)
        rug = {"color": "0.4", "ms": 6, "transform": axes.get_xaxis_transform(), "label": "sources"}
        axes.plot(magnitudes, np.full(magnitudes.size, 0.02), "|", **rug)
        unit = "µas" if vector == "orientation" else "µas/yr"
        axes.set(xlabel="magnitude  [mag]", ylabel=f"{vector}  [{unit}]")
    legend_above(panel_axes[0], 4)
    axes = panel_axes[len(vector_names)]
    influence = np.abs(solution.influence).max(1)
    outlier = solution.outlier > 0.5
    for selection, tint, marker, label in ((~outlier, COLOURS[0], "o", "source"), (outlier, "0.2", "x", "outlier")):
        axes.scatter(solution.distances[selection], influence[selection], color=tint, marker=marker, s=14, label=label)
    axes.legend(fontsize="x-small", loc="best")
    # Those of most influence may stand side by side: the leftmost has its name at the left, the others step down.
    named = np.argsort(-influence)[:3]
    corners = (((-6, 3), "right"), ((6, 6), "left"), ((6, -8), "left"))
    for i, (offset, side) in zip(named[np.argsort(solution.distances[named])], corners, strict=False):
        axes.annotate(
            solution.sources[i], (solution.distances[i], influence[i]), textcoords="offset points", xytext=offset,
            ha=side, fontsize="x-small", arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.4},
        )  # fmt: skip
    axes.set(xscale="log", xlabel="√χ² per difference of a source, by its formal errors")
    set_log_ticks(axes.xaxis, *axes.get_xlim())
    axes.set_ylabel("change without it  [σ]")
    return panel_axes


@apply_style
def plot_step_probabilities(search: Any, *, ax: Axes | None = None) -> Axes:
    """Probability of each place of a jump, and what lies between."""
    (axes,) = panels(ax, size=(WIDTH, 2.6))
    axes.vlines(search.places, 0, search.probability, color=COLOURS[0], linewidth=1)
    axes.plot(search.places, search.probability, "o", color=COLOURS[0], markersize=4)
    axes.axvspan(*search.interval, color=COLOURS[0], alpha=0.12, linewidth=0, label="68 % of the probability")
    axes.set(ylim=(0, None), xlabel="magnitude at which the frame jumps", ylabel="probability of this place")
    legend_above(axes)
    return axes


@apply_style
def plot_plan(plan: Any, *, ax: Axes | None = None) -> Axes:
    """Errors of the parameters after each candidate, in those of today."""
    (axes,) = panels(ax, size=(WIDTH, 3.0))
    n_observed = np.arange(len(plan.candidates) + 1)
    for k, name in enumerate(plan.names):
        axes.plot(n_observed, np.r_[1, plan.sigma[:, k] / plan.before[k]], color=COLOURS[k % len(COLOURS)], label=name)
    axes.set(xlabel="candidates observed, the best first", ylabel="error, in that of today")
    legend_above(axes, 3)
    return axes
