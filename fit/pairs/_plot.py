"""Figures of pairs (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels
from vsh.tools.types import Axes, AxesArray, OnAxes

_PLUS, _MINUS = COLOURS[0], COLOURS[2]
_ANGLE_LABEL, _CORRELATION_LABEL = "angle between the sources  [°]", "correlation  [(µas/yr)²]"


@apply_style
def plot_pairs(correlation: Any, fit: Any = None, *, ax: OnAxes | None = None) -> AxesArray:
    """ξ± with errors and the fitted templates above, the pairs in each bin below."""
    axes, pair_axes = panel_axes = panels(ax, 2, 1, size=(WIDTH, 3.6), sharex=True, height_ratios=(3, 1))
    degrees = np.degrees(correlation.theta)
    step = 0.12 * np.min(np.diff(degrees)) if len(degrees) > 1 else 0.0
    for values, sigma, shift, marker, colour, label in (
        (correlation.plus, correlation.sigma_plus, -step, "o", _PLUS, "ξ₊"),
        (correlation.minus, correlation.sigma_minus, step, "s", _MINUS, "ξ₋"),
    ):
        error = sigma if np.isfinite(sigma).any() else None
        axes.errorbar(degrees + shift, values, error, fmt=marker, markersize=3, color=colour, label=label)
    if fit is not None:
        for curve, colour, label in zip(fit.curves, (_PLUS, _MINUS), ("fit of ξ₊", "fit of ξ₋"), strict=True):
            axes.plot(degrees, curve, color=colour, alpha=0.8, label=label)
    axes.axhline(0, color="0.6", linewidth=0.6, zorder=1)
    axes.set_ylabel(_CORRELATION_LABEL)
    legend_above(axes, 4)
    if correlation.edges[-1] > np.pi / 2:
        axes.set_xticks(range(0, 181, 30))
    power = 3 * int(np.log10(max(correlation.n_pairs.max(), 1)) // 3)
    widths = np.diff(np.degrees(correlation.edges))
    pair_axes.bar(
        degrees,
        np.maximum(correlation.n_pairs, 0) / 10.0**power,
        (widths[:-1] + widths[1:]) / 2,
        color="0.75",
        edgecolor="white",
    )
    pair_axes.set(xlabel=_ANGLE_LABEL, ylabel=f"pairs\n[$10^{power}$]" if power else "pairs")
    return panel_axes


@apply_style
def plot_curves(fit: Any, *, ax: Axes | None = None) -> Axes:
    """The curves of fitted templates."""
    (axes,) = panels(ax)
    for curve, colour, label in zip(fit.curves, (_PLUS, _MINUS), ("ξ₊", "ξ₋"), strict=True):
        axes.plot(np.degrees(fit.theta), curve, color=colour, label=label)
    axes.axhline(0, color="0.6", linewidth=0.6, zorder=1)
    axes.set(xlabel=_ANGLE_LABEL, ylabel=_CORRELATION_LABEL)
    legend_above(axes)
    return axes
