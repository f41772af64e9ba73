"""Figures of backgrounds (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from vsh.types import Figure

_COLOURS = ("#0b5394", "#c55a11", "#38761d")
_LABELS = {"flat": "flat in Ω", "root": "flat in √Ω", "coefficients": "coefficients flat"}


def plot_waves(limit: Any) -> Figure:
    """The posteriors of Ω for priors flat in Ω and in √Ω, with the upper limits.

    Parameters
    ----------
    limit : WaveLimit
        What was found.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    top = 1.35 * limit.limit(0.95, "flat")
    omega = np.linspace(0, top, 1500)[1:]
    for colour, prior in zip(_COLOURS, ("flat", "root"), strict=False):
        density = limit.likelihood(omega) * (1 if prior == "flat" else omega**-0.5)
        density /= np.sum(density) * (omega[1] - omega[0])
        axes.plot(omega, density, color=colour, linewidth=1.8, label=f"exact likelihood, {_LABELS[prior]}")
    highest = float(np.max(limit.likelihood(omega) / (np.sum(limit.likelihood(omega)) * (omega[1] - omega[0]))))
    axes.set_ylim(0, 1.6 * highest)  # a prior flat in √Ω rises without end towards zero
    known = [prior for prior in _LABELS if prior != "coefficients" or np.isfinite(limit.squares).all()]
    for height, prior in zip((0.88, 0.74, 0.60), known, strict=False):
        colour, value = _COLOURS[list(_LABELS).index(prior)], limit.limit(0.95, prior)
        axes.axvline(value, color=colour, linestyle="--", linewidth=1.2)
        axes.annotate(
            f"< {value:.3g}, {_LABELS[prior]}", (value, height), xycoords=("data", "axes fraction"), xytext=(-5, 0),
            textcoords="offset points", ha="right", va="center", fontsize=11, color=colour,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.85},
        )  # fmt: skip
    axes.set_xlim(0, top)
    axes.set_xlabel(
        "$h_{70}^2\\,\\Omega_\\mathrm{GW}$" if limit.hubble == 70 else "$\\Omega_\\mathrm{GW}$", fontsize=13
    )
    axes.set_ylabel("posterior density; dashed: 95 % limits", fontsize=13)
    axes.tick_params(labelsize=11)
    axes.legend(edgecolor="none", framealpha=0.9, fontsize=11, loc="upper right", bbox_to_anchor=(1, 0.5))
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def plot_floor(floor: Any) -> Figure:
    """The power of a mode of either parity, with 68 % intervals.

    Parameters
    ----------
    floor : Floor
        What was found.

    Returns
    -------
    matplotlib figure
    """
    names = [
        f"odd parity: spin ± {floor.spin_error:.3g} µas/yr",
        f"even parity: acceleration ± {floor.acceleration_error:.3g} µas/yr",
    ]
    intervals, label = [floor.odd_interval, floor.even_interval], "power of a mode  [(µas/yr)²]"
    return _intervals(names, [floor.odd, floor.even], intervals, [label, label], "median")


def plot_amplitudes(background: Any) -> Figure:
    """The amplitudes of the spectra with 68 % intervals.

    Parameters
    ----------
    background : Background
        What was found.

    Returns
    -------
    matplotlib figure
    """
    labels = ["amplitude"] * len(background.names)
    return _intervals(background.names, background.amplitudes, background.intervals, labels, "largest likelihood")


def plot_comparison(comparison: Any) -> Figure:
    """The evidences less the best.

    Parameters
    ----------
    comparison : Comparison
        What was found.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 1.2 + 0.45 * len(comparison.names)), layout="constrained")
    below = comparison.log_evidence - comparison.log_evidence.max()
    place = np.arange(len(below))[::-1]
    axes.barh(place, below, color=_COLOURS[0], height=0.6)
    axes.plot(np.zeros(len(below)), place, "|", color="0.3", markersize=10)
    axes.set_yticks(place, comparison.names, fontsize=12)
    axes.set_xlabel("ln Z less that of the best", fontsize=13)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _intervals(names, values, intervals, labels, point):
    """One axis for each amplitude: they have units of their own."""
    figure, rows = plt.subplots(
        len(names), 1, figsize=(8, 1.4 + 1.25 * len(names)), layout="constrained", squeeze=False
    )
    for axes, name, value, (low, high), label in zip(rows[:, 0], names, values, intervals, labels, strict=True):
        axes.hlines(0, low, high, color=_COLOURS[0], linewidth=3, label="68 %")
        axes.plot(value, 0, "o", color=_COLOURS[1], markersize=10, label=point)
        axes.set_title(name, fontsize=12, loc="left")
        axes.set_xlim(-0.02 * high, 1.15 * max(high, value, 1e-30))
        axes.set_yticks([])
        axes.set_xlabel(label, fontsize=11)
        axes.tick_params(labelsize=11)
        axes.spines[["top", "right", "left"]].set_visible(False)
    rows[0, 0].legend(frameon=False, fontsize=11, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    return figure
