"""The figures of the study (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fit.output import plot_correlation, plot_residuals, plot_spectrum
from study.gaia._fits import DegreeOrSubset
from study.gaia._published import COMPONENTS, ERRORS
from study.gaia._run import GaiaStudy
from vsh.plot import COLOURS, WIDTH, legend_above, panels, plot_field, plot_map, styled
from vsh.sky.pixels import pixels_of

CAPTIONS = {
    "acceleration_by_degree": "The acceleration by the highest degree of the fit: thick bars from the bootstrap, thin ones the "
    "catalogue's; bands: the published values.",
    "acceleration_by_subset": "The acceleration by subsets of the sources: bars from the bootstrap; lines: all five-parameter sources.",
    "density": "Sources a square degree.",
    "powers": "Power by degree of the highest fit, errors from the bootstrap.",
}


def draw(study: GaiaStudy, truth: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """All figures, by name."""
    main: Any = study.main
    five = study.sources.field[~study.sources.six]
    highest: Any = next((row for row in reversed(study.degrees) if row.resampled is not None), main)
    return {
        "acceleration_by_degree": _by_degree(study.degrees, truth),
        "acceleration_by_subset": _by_subset(study.subsets),
        "powers": plot_spectrum(highest.resampled),
        "density": _density(five),
        "sky": plot_field(five, main.solution.coefficients, covariance=main.resampled.covariance),
        "correlation": plot_correlation(main.solution),
        "residuals": plot_residuals(main.solution, five),
    }


@styled
def _by_degree(rows, truth):
    (axes,) = panels(None, size=(WIDTH, 2.7))
    good = [(i + 1, row) for i, row in enumerate(rows) if row.resampled is not None]
    known = truth["acceleration"].value if truth else COMPONENTS
    for k, (axis, colour) in enumerate(zip("xyz", COLOURS, strict=False)):
        x = np.array([lmax for lmax, _ in good]) + (k - 1) * 0.15
        value = [row.resampled.acceleration.value[k] for _, row in good]
        thin = [row.solution.acceleration.sigma[k] for _, row in good]
        axes.errorbar(x, value, thin, fmt="none", color=colour, linewidth=0.6)
        thick = [row.resampled.acceleration.sigma[k] for _, row in good]
        axes.errorbar(
            x, value, thick, fmt="os^"[k], color=colour, linewidth=1.8, capsize=0, alpha=0.7, label=f"$g_{axis}$"
        )
        if truth:
            axes.axhline(known[k], color=colour, linestyle=":")
        else:
            axes.axhspan(known[k] - ERRORS[k], known[k] + ERRORS[k], color=colour, alpha=0.12, linewidth=0)
    axes.set_xticks([lmax for lmax, _ in good])
    axes.set(xlabel="highest degree of the fit", ylabel="acceleration  [µas/yr]")
    legend_above(axes, 3)
    axes.set_title(
        "dotted: the truth" if truth else "bands: Klioner et al. (2021), degree 3", loc="right", fontsize=6.5
    )
    return axes


@styled
def _by_subset(rows: Sequence[DegreeOrSubset]) -> Any:
    good: list[Any] = [row for row in rows if row.resampled is not None]
    drawn = panels(None, 1, 3, size=(WIDTH, 0.16 * max(len(good), 3) + 0.7), sharey=True)
    if not good:  # no subset has sources enough
        drawn[1].set_title("no subset has sources enough", fontsize=6.5)
        return drawn
    y = -np.arange(len(good))
    for k, (axes, axis, colour) in enumerate(zip(drawn, "xyz", COLOURS, strict=False)):
        value = np.array([row.resampled.acceleration.value[k] for row in good])
        error = np.array([row.resampled.acceleration.sigma[k] for row in good])
        axes.errorbar(value, y, xerr=error, fmt="os^"[k], color=colour, markersize=2.5)
        axes.axvline(value[0], color="0.6", linewidth=0.6, zorder=0)
        # Small subsets do not set the scale for all.
        reach = 6 * np.median(error)
        axes.set_xlim(value[0] - reach, value[0] + reach)
        axes.set_xlabel(f"$g_{axis}$  [µas/yr]")
    drawn[0].set_yticks(y, [f"{row.name} ({row.n_sources})" for row in good], fontsize=5.5)
    return drawn


def _density(field):
    nside = 2 ** int(np.clip(np.log2(len(field) / 120) / 2, 2, 6))  # ten sources in a pixel
    counts = np.bincount(pixels_of(field.lon, field.lat, nside), minlength=12 * nside**2) / (41253 / (12 * nside**2))
    shown = np.where(counts > 0, counts, np.nan)
    return plot_map(
        shown, "sources a square degree", frame=field.frame, vmin=0, vmax=np.percentile(counts, 99), extend="max"
    )
