"""The figures of the study (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fit.output import plot_correlation, plot_residuals, plot_spectrum
from study.gaia._fits import DegreeOrSubset
from study.gaia._published import COMPONENTS, ERRORS
from study.gaia._run import GaiaStudy
from vsh.sky.pixels import pixels_of
from vsh.sky.plot import draw_map, plot_field, sky_axes
from vsh.types import Figure

_COLOURS = ("#c55a11", "#0b5394", "#38761d")
CAPTIONS = {
    "acceleration_by_degree": "The acceleration by the highest degree of the fit: thick bars from the bootstrap, thin ones the "
    "catalogue's; bands: the published values.",
    "acceleration_by_subset": "The acceleration by subsets of the sources: bars from the bootstrap; lines: all five-parameter sources.",
    "density": "Sources a square degree.",
    "powers": "Power by degree of the highest fit, errors from the bootstrap.",
}


def draw(study: GaiaStudy, truth: Mapping[str, Any] | None = None) -> dict[str, Figure]:
    """All figures, by name.

    Parameters
    ----------
    study : GaiaStudy
        What was found.
    truth : dict, optional
        Of a simulated catalogue: drawn in place of the published values.
    """
    main: Any = study.main
    five = study.sources.field[~study.sources.six]
    highest: Any = next((row for row in reversed(study.degrees) if row.resampled is not None), main)
    return {
        "acceleration_by_degree": _by_degree(study.degrees, truth),
        "acceleration_by_subset": _by_subset(study.subsets),
        "powers": plot_spectrum(highest.resampled),
        "density": _density(five),
        "sky": plot_field(five, main.solution.coefficients),
        "correlation": plot_correlation(main.solution),
        "residuals": plot_residuals(main.solution, five),
    }


def _by_degree(rows, truth):
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    good = [(i + 1, row) for i, row in enumerate(rows) if row.resampled is not None]
    known = truth["acceleration"].value if truth else COMPONENTS
    for k, (axis, colour) in enumerate(zip("xyz", _COLOURS, strict=True)):
        x = np.array([lmax for lmax, _ in good]) + (k - 1) * 0.15
        value = [row.resampled.acceleration.value[k] for _, row in good]
        axes.errorbar(
            x, value, [row.solution.acceleration.sigma[k] for _, row in good], fmt="none", color=colour, linewidth=1
        )
        axes.errorbar(x, value, [row.resampled.acceleration.sigma[k] for _, row in good], fmt="o", color=colour, linewidth=3,
                      alpha=0.7, label=f"$g_{axis}$")  # fmt: skip
        if truth:
            axes.axhline(known[k], color=colour, linestyle=":")
        else:
            error = ERRORS[k]
            axes.axhspan(known[k] - error, known[k] + error, color=colour, alpha=0.12, linewidth=0)
    axes.set_xticks([lmax for lmax, _ in good])
    axes.set_xlabel("highest degree of the fit", fontsize=13)
    axes.set_ylabel("acceleration  [µas/yr]", fontsize=13)
    axes.legend(frameon=False, fontsize=12, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title("dotted: the truth" if truth else "bands: Klioner et al. (2021), degree 3", fontsize=12, loc="right")
    return figure


def _by_subset(rows: Sequence[DegreeOrSubset]) -> Figure:
    good: list[Any] = [row for row in rows if row.resampled is not None]
    figure, all_axes = plt.subplots(1, 3, figsize=(10, 0.32 * len(good) + 1.5), sharey=True, layout="constrained")
    y = -np.arange(len(good))
    for k, (axes, axis, colour) in enumerate(zip(all_axes, "xyz", _COLOURS, strict=True)):
        value = np.array([row.resampled.acceleration.value[k] for row in good])
        error = np.array([row.resampled.acceleration.sigma[k] for row in good])
        axes.errorbar(value, y, xerr=error, fmt="o", color=colour, linewidth=2)
        axes.axvline(value[0], color="0.6", linewidth=1, zorder=0)
        # Small subsets do not set the scale for all.
        reach = 6 * np.median(error)
        axes.set_xlim(value[0] - reach, value[0] + reach)
        axes.set_xlabel(f"$g_{axis}$  [µas/yr]", fontsize=13)
        axes.spines[["top", "right"]].set_visible(False)
    all_axes[0].set_yticks(y, [f"{row.name} ({row.n_sources})" for row in good], fontsize=10)
    return figure


def _density(field):
    nside = 32
    counts = np.bincount(pixels_of(field.lon, field.lat, nside), minlength=12 * nside**2) / (41253 / (12 * nside**2))
    axes = sky_axes(field.frame)
    image = draw_map(axes, np.where(counts > 0, counts, np.nan), vmin=0, vmax=np.percentile(counts, 99))
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label("sources a square degree", fontsize=12)
    return axes.figure
