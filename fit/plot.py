"""Figures of a solution: its spectrum and its correlations (matplotlib)."""

import matplotlib.pyplot as plt
import numpy as np

from fit.spectrum import spectrum

_COLOURS = {"T": "#c55a11", "S": "#0b5394"}
_NAMES = {"T": "toroidal", "S": "spheroidal"}


def plot_spectrum(solution):
    """Power by degree and kind, with what noise alone gives on average.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    rows = spectrum(solution)
    for kind, side in (("T", -1), ("S", 1)):
        degrees = [row for row in rows if row.kind == kind]
        l = np.array([row.l for row in degrees])
        power, error = (np.array([getattr(row, x) for row in degrees]) for x in ("power", "error"))
        # On a logarithmic axis an error as large as the power has no lower end.
        below = np.minimum(error, power * 0.9)
        axes.errorbar(
            l + side * 0.08, power, [below, error], fmt="o" if kind == "T" else "s", color=_COLOURS[kind],
            capsize=3, label=_NAMES[kind],
        )  # fmt: skip
        noise = [row.noise for row in degrees]
        axes.hlines(noise, l, l + side * 0.3, color=_COLOURS[kind], linestyle=":", label=f"noise alone, {_NAMES[kind]}")
    axes.set_yscale("log")
    axes.set_xticks(np.unique([row.l for row in rows]) if len(rows) <= 40 else None)
    axes.set_xlabel("degree", fontsize=13)
    axes.set_ylabel("power  [(µas/yr)²]", fontsize=13)
    axes.tick_params(labelsize=11)
    axes.legend(frameon=False, fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def plot_correlation(solution):
    """The correlation matrix of the coefficients, colour-blind safe and centred on zero.

    Returns
    -------
    matplotlib figure
    """
    names = [str(mode) for mode in solution.modes]
    figure, axes = plt.subplots(figsize=(8, 6.8), layout="constrained")
    off = solution.correlation - np.eye(len(names))
    largest = max(float(np.abs(off).max()), 1e-3)
    image = axes.imshow(np.where(np.eye(len(names)) > 0, np.nan, off), cmap="RdBu_r", vmin=-largest, vmax=largest)
    bar = figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label("correlation (diagonal left out)", fontsize=12)
    step = max(1, len(names) // 32)
    axes.set_xticks(range(0, len(names), step), names[::step], rotation=90, fontsize=11 if len(names) < 20 else 8)
    axes.set_yticks(range(0, len(names), step), names[::step], fontsize=11 if len(names) < 20 else 8)
    half = len(names) / 2 - 0.5
    axes.axhline(half, color="0.4", linewidth=0.8)
    axes.axvline(half, color="0.4", linewidth=0.8)
    axes.set_title(f"{_NAMES['T']} first, then {_NAMES['S']}; {solution.frame}", fontsize=12)
    return figure
