"""Dipoles against redshift (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, figure_of, legend_above, panels, set_log_ticks
from vsh.models.cosmology import FLOW_LIMIT, transverse_distance, velocity_in_frame
from vsh.sky.frames import title_of
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, AxesArray, OnAxes
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector


@apply_style
def plot_bins(binned: Any, velocity: str | Vector | None = "planck", *, ax: OnAxes | None = None) -> AxesArray:
    """Spin and acceleration, components and amplitude, in each bin."""
    subplots = panels(ax, 4, 1, size=(WIDTH, 6.6), sharex=True, height_ratios=(2, 1, 2, 1))
    # A bin measures the mean of 1/d, and that is where its marker stands.
    z, edges = np.clip(binned.effective_redshift, binned.edges[:-1], binned.edges[1:]), binned.edges
    is_logarithmic = edges[0] > 0 and edges[-1] > 5 * edges[0]
    for (component_axes, size_axes), name, symbol in zip(
        subplots.reshape(2, 2), ("acceleration", "spin"), ("ã", "ω"), strict=True
    ):
        vectors = binned.vectors(name)
        for i, (values, errors) in enumerate(np.transpose([(v.value, v.sigma) for v in vectors], (2, 1, 0))):
            positions = z * 1.03 ** (i - 1) if is_logarithmic else z + (i - 1) * 0.006 * (edges[-1] - edges[0])
            _draw_component(component_axes, i, positions, values, errors, symbol)
        component_axes.axhline(0, color="0.7", linewidth=0.6, zorder=0)
        component_axes.set_ylabel(f"{name}  [µas/yr]")
        amplitudes_and_errors, redshift_errors = (
            np.transpose([(v.amplitude, v.amplitude_error) for v in vectors]),
            [z - edges[:-1], edges[1:] - z],
        )
        size_axes.errorbar(z, *amplitudes_and_errors, xerr=redshift_errors, fmt="s", color="0.25", label="as fitted")
        debiased = [v.debiased_amplitude for v in vectors]
        size_axes.plot(
            z, debiased, "D", color="0.5", mfc="w", ms=3.5, mew=0.8, label="noise-debiased", zorder=4, clip_on=False
        )
        size_axes.set(ylabel=f"|{symbol}|  [µas/yr]", ylim=(0, None))
    if velocity is not None:
        _draw_secular_parallax(binned, velocity, subplots[:2])
    for axes in subplots:
        legend_above(axes, 3)
    subplots[-1].set_xlabel("redshift (markers: where the mean of 1/distance is)")
    for axes in subplots:
        axes.set_xscale("log" if is_logarithmic else "linear")
        if is_logarithmic:
            lower = max(edges[0], z.min() / 20)  # a first bin from next to nothing would take half the axis
            axes.set_xlim(lower / 1.2, edges[-1] * 1.2)
            set_log_ticks(axes.xaxis, lower, edges[-1])
    figure_of(subplots).suptitle(f"{binned.counts.sum()} sources in {len(binned)} bins; {title_of(binned.frame)} axes")
    return subplots


def _draw_component(axes, i, positions, values, errors, symbol):
    """A component of vectors with its errors, in the colour and the marker that it has in every panel."""
    axes.errorbar(positions, values, errors, fmt="os^"[i], color=COLOURS[i], label=f"{symbol}$_{'xyz'[i]}$")


def _draw_secular_parallax(binned_solution, velocity, axes_pair):
    velocity = velocity_in_frame(velocity, binned_solution.frame)
    try:
        acceleration, _ = binned_solution.secular_parallax(velocity)
    except ParameterError:
        return  # bins without a distance: there is nothing to predict
    component_axes, size_axes = axes_pair
    edges = binned_solution.edges
    lower = edges[0] if edges[0] > 0 else binned_solution.redshift[0] / 3
    z_grid = np.geomspace(max(lower, FLOW_LIMIT), edges[-1], 200)
    curves = acceleration.value[:, None] - np.outer(velocity.value, 1 / (AU_PER_YEAR * transverse_distance(z_grid)))
    for curve, colour in zip(curves, COLOURS, strict=False):
        component_axes.plot(z_grid, curve, color=colour, linestyle="--", linewidth=0.7, zorder=0.5)
    # What the test compares with: one value a bin.
    means = acceleration.value[:, None] - np.outer(velocity.value, binned_solution.mean_inverse_distance) / AU_PER_YEAR
    for mean, colour in zip(means, COLOURS, strict=False):
        component_axes.hlines(mean, edges[:-1], edges[1:], color=colour, linewidth=1.6, alpha=0.35, zorder=0.6)
    component_axes.plot([], [], color="0.4", linewidth=1.6, alpha=0.35, label="mean of ã − v/d in a bin")
    component_axes.plot(
        [], [], color="0.4", linestyle="--", linewidth=0.7, label=f"ã − v/d, |v| = {velocity.amplitude:.0f} km/s"
    )
    size_axes.plot(z_grid, np.linalg.norm(curves, axis=0), color="0.4", linestyle="--", linewidth=0.7, label="ã − v/d")
    # The curves may run off where there are few sources: the data set the scale.
    lower, upper = zip(
        *[(v.value - v.sigma, v.value + v.sigma) for v in (s.acceleration for s in binned_solution.solutions)]
    )
    value_range = np.ptp([np.min(lower), np.max(upper)])
    component_axes.set_ylim(np.min(lower) - 0.3 * value_range, np.max(upper) + 0.3 * value_range)
    top = max(s.acceleration.amplitude + s.acceleration.amplitude_error for s in binned_solution.solutions)
    size_axes.set_ylim(0, 1.3 * top)


@apply_style
def plot_trend(trend: Any, *, ax: Axes | None = None) -> Axes:
    """Slopes of spin and acceleration with redshift."""
    (axes,) = panels(ax)
    for position, (vector, symbol) in enumerate(((trend.spin, "ω"), (trend.acceleration, "ã"))):
        for i, (value, error) in enumerate(zip(vector.value, vector.sigma, strict=True)):
            _draw_component(axes, i, position + (i - 1) * 0.15, value, error, symbol)
    axes.axhline(0, color="0.7", linewidth=0.6, zorder=0)
    axes.set_xticks([0, 1], ["spin", "acceleration"])
    axes.set(xlim=(-0.5, 1.5), ylabel="slope  [µas/yr per unit of x]")
    legend_above(axes, 6)
    return axes
