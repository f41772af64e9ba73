"""Figures of pairs (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from vsh.types import Figure

_PLUS, _MINUS = "#0b5394", "#c55a11"


def plot_pairs(found: Any, fit: Any = None) -> Figure:
    """ξ± with errors and the fitted templates above, the pairs in each bin below.

    Parameters
    ----------
    found : Correlation
        What to draw.
    fit : TemplateFit, optional
        Whose curves are drawn.

    Returns
    -------
    matplotlib figure
    """
    figure, (axes, below) = plt.subplots(
        2, 1, figsize=(8, 6.4), sharex=True, layout="constrained", height_ratios=(3, 1)
    )
    degrees = np.degrees(found.theta)
    step = 0.12 * np.min(np.diff(degrees)) if len(degrees) > 1 else 0.0
    for values, sigma, side, marker, colour, label in (
        (found.plus, found.sigma_plus, -step, "o", _PLUS, "ξ₊"), (found.minus, found.sigma_minus, step, "s", _MINUS, "ξ₋"),
    ):  # fmt: skip
        error = sigma if np.isfinite(sigma).any() else None
        axes.errorbar(degrees + side, values, error, fmt=marker, markersize=5, capsize=3, color=colour, label=label)
    if fit is not None:
        said = ", ".join(
            f"{name} {value:.3g} ± {error:.2g}"
            for name, value, error in zip(fit.names, fit.values, fit.sigma, strict=True)
        )
        for curve, colour in zip(fit.curves, (_PLUS, _MINUS), strict=True):
            axes.plot(degrees, curve, color=colour, linewidth=1.6, alpha=0.8)
        axes.set_title(f"lines: {said}", fontsize=12)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set_ylabel("correlation of motions  [(µas/yr)²]", fontsize=13)
    axes.legend(frameon=False, fontsize=12)
    width = np.diff(np.degrees(found.edges))
    below.bar(degrees, np.maximum(found.n_pairs, 0), (width[:-1] + width[1:]) / 2, color="0.75", edgecolor="white")
    below.set_ylabel("pairs", fontsize=13)
    below.set_xlabel("angle between the sources  [°]", fontsize=13)
    for each in (axes, below):
        each.tick_params(labelsize=11)
        each.spines[["top", "right"]].set_visible(False)
    return figure


def plot_curves(fit: Any) -> Figure:
    """The curves of fitted templates.

    Parameters
    ----------
    fit : TemplateFit
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 4.6), layout="constrained")
    for curve, colour, label in zip(fit.curves, (_PLUS, _MINUS), ("ξ₊", "ξ₋"), strict=True):
        axes.plot(np.degrees(fit.theta), curve, color=colour, label=label)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set_xlabel("angle between the sources  [°]", fontsize=13)
    axes.set_ylabel("correlation of motions  [(µas/yr)²]", fontsize=13)
    axes.legend(frameon=False, fontsize=12)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def plot_power(found: Any) -> Figure:
    """Power by degree with its errors, of either sign.

    Parameters
    ----------
    found : PairPower
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 4.6), layout="constrained")
    l = np.arange(1, len(found.toroidal) + 1)
    for values, error, side, marker, colour, label in (
        (found.toroidal, found.errors[0], -0.08, "o", _MINUS, "toroidal"),
        (found.spheroidal, found.errors[1], 0.08, "s", _PLUS, "spheroidal"),
    ):
        error = error if np.isfinite(error).all() else None
        axes.errorbar(l + side, values, error, fmt=marker, capsize=3, color=colour, label=label)
    axes.axhline(0, color="0.6", linewidth=0.8)
    if len(l) <= 40:
        axes.set_xticks(l)
    axes.set_xlabel("degree", fontsize=13)
    axes.set_ylabel("power from pairs  [(µas/yr)²]", fontsize=13)
    axes.legend(frameon=False, fontsize=12)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
