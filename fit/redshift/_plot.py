"""Dipoles against redshift (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from vsh.cosmology import FLOW_LIMIT, transverse_distance, velocity_along
from vsh.errors import ParameterError
from vsh.types import Figure
from vsh.units import AU_PER_YEAR
from vsh.vector import Vector

_COLOURS = ("#0b5394", "#c55a11", "#38761d")


def plot_bins(binned: Any, velocity: str | Vector | None = "planck") -> Figure:
    """Spin and acceleration, components and amplitude, in each bin.

    Parameters
    ----------
    binned : BinnedSolution
        The bins.
    velocity : "planck", Vector or None
        Whose secular parallax is drawn in, about the acceleration that fits
        best with it.

    Returns
    -------
    matplotlib figure
    """
    figure, panels = plt.subplots(2, 2, figsize=(11, 7.5), sharex=True, layout="constrained")
    # A bin measures the mean of 1/d, and that is where its marker stands.
    z, edges = np.clip(binned.effective_redshift, binned.edges[:-1], binned.edges[1:]), binned.edges
    logarithmic = edges[0] > 0 and edges[-1] > 5 * edges[0]
    for (components, amplitude), name, symbol in zip(panels, ("acceleration", "spin"), ("ã", "ω"), strict=True):
        vectors = [getattr(solution, name) for solution in binned.solutions]
        for i, (axis, colour) in enumerate(zip("xyz", _COLOURS, strict=True)):
            away = z * 1.03 ** (i - 1) if logarithmic else z + (i - 1) * 0.006 * (edges[-1] - edges[0])
            components.errorbar(
                away, [v.value[i] for v in vectors], [v.sigma[i] for v in vectors], fmt="o", color=colour, capsize=3,
                label=f"{symbol}$_{axis}$",
            )  # fmt: skip
        components.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        components.set_ylabel(f"{name}  [µas/yr]", fontsize=13)
        amplitude.errorbar(
            z, [v.amplitude for v in vectors], [v.amplitude_error for v in vectors],
            xerr=[z - edges[:-1], edges[1:] - z], fmt="s", color="0.25", capsize=3, label="as fitted",
        )  # fmt: skip
        amplitude.plot(
            z, [v.debiased_amplitude for v in vectors], "_", color="#c55a11", ms=14, mew=2, label="noise-debiased"
        )
        amplitude.set_ylabel(f"|{symbol}|  [µas/yr]", fontsize=13)
        amplitude.set_ylim(bottom=0)
    if velocity is not None:
        _draw_prediction(binned, velocity, panels[0])
    for axes in panels.ravel():
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=11)
        axes.legend(frameon=False, fontsize=10, ncols=2)
    for axes in panels[1]:
        axes.set_xlabel("redshift", fontsize=13)
        axes.set_xscale("log" if logarithmic else "linear")
    figure.suptitle(f"{binned.counts.sum()} sources in {len(binned)} bins; {binned.frame} axes", fontsize=13)
    return figure


def _draw_prediction(binned, velocity, panels):
    velocity = velocity_along(velocity, binned.frame)
    try:
        acceleration, _ = binned.secular_parallax(velocity)
    except ParameterError:
        return  # bins without a distance: there is nothing to predict
    edges = binned.edges
    low = edges[0] if edges[0] > 0 else binned.redshift[0] / 3
    grid = np.geomspace(max(low, FLOW_LIMIT), edges[-1], 200)
    curves = acceleration.value[:, None] - np.outer(velocity.value, 1 / (AU_PER_YEAR * transverse_distance(grid)))
    for curve, colour in zip(curves, _COLOURS, strict=True):
        panels[0].plot(grid, curve, color=colour, linestyle="--", linewidth=1, zorder=0.5)
    # What the test compares with: one value a bin.
    steps = acceleration.value[:, None] - np.outer(velocity.value, binned.mean_inverse_distance) / AU_PER_YEAR
    for step, colour in zip(steps, _COLOURS, strict=True):
        panels[0].hlines(step, edges[:-1], edges[1:], color=colour, linewidth=2, alpha=0.35, zorder=0.6)
    panels[0].plot([], [], color="0.4", linestyle="--", label=f"ã − v/d, |v| = {velocity.amplitude:.0f} km/s")
    panels[1].plot(grid, np.linalg.norm(curves, axis=0), color="0.4", linestyle="--", linewidth=1, label="ã − v/d")
    # The curves may run off where there are few sources: the data set the scale.
    low, high = zip(*[(v.value - v.sigma, v.value + v.sigma) for v in (s.acceleration for s in binned.solutions)])
    reach = np.ptp([np.min(low), np.max(high)])
    panels[0].set_ylim(np.min(low) - 0.3 * reach, np.max(high) + 0.3 * reach)
    panels[1].set_ylim(
        0, 1.3 * max(s.acceleration.amplitude + s.acceleration.amplitude_error for s in binned.solutions)
    )


def plot_trend(trend: Any) -> Figure:
    """Slopes of spin and acceleration with redshift.

    Parameters
    ----------
    trend : Trend
        What to draw.
    """
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for at, (vector, symbol) in enumerate(((trend.spin, "ω"), (trend.acceleration, "ã"))):
        for i, (axis, colour) in enumerate(zip("xyz", _COLOURS, strict=True)):
            axes.errorbar(
                at + (i - 1) * 0.15, vector.value[i], vector.sigma[i], fmt="o", color=colour, capsize=3,
                label=f"{symbol}$_{axis}$",
            )  # fmt: skip
    axes.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    axes.set_xticks([0, 1], ["spin", "acceleration"], fontsize=13)
    axes.set_ylabel("slope  [µas/yr per unit of x]", fontsize=13)
    axes.legend(frameon=False, fontsize=10, ncols=2)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
