"""Figures of a solution: its spectrum and its correlations (matplotlib)."""

from __future__ import annotations

from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fit.harmonic import HarmonicSolution
from fit.output._rows import squared
from fit.spectrum import spectrum
from vsh.checks.weighed import Weighed
from vsh.field import Field
from vsh.modes import KINDS
from vsh.parts import Parts, as_parts
from vsh.scalars import ScalarField
from vsh.sky.pixels import pixels_of
from vsh.sky.plot import draw_map, sky_axes
from vsh.types import Figure

_COLOURS = {"T": "#c55a11", "S": "#0b5394", "F": "#0b5394"}
_NAMES = {"T": "toroidal", "S": "spheroidal", "F": "scalar"}


def plot_spectrum(solution: HarmonicSolution) -> Figure:
    """Power by degree and kind, with what noise alone gives on average.

    Parameters
    ----------
    solution : Solution
        What was found.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    rows = spectrum(solution)
    for kind, side in zip(solution.modes.kinds, (-1, 1), strict=False):
        degrees = [row for row in rows if row.kind == kind]
        l = np.array([row.l for row in degrees])
        power, error = (np.array([getattr(row, x) for row in degrees]) for x in ("power", "error"))
        axes.errorbar(
            l + side * 0.08, power, error, fmt="o" if kind == "T" else "s", color=_COLOURS[kind],
            capsize=3, label=_NAMES[kind],
        )  # fmt: skip
        noise = [row.noise for row in degrees]
        axes.hlines(noise, l, l + side * 0.3, color=_COLOURS[kind], linestyle=":", label=f"noise alone, {_NAMES[kind]}")
    # An error as large as the power has no lower end on a logarithmic axis: its bar runs out of it.
    axes.set_yscale("log", nonpositive="clip")
    levels = np.array([(row.power, row.power + row.error, row.noise) for row in rows])
    axes.set_ylim(np.nanmin(levels) / 4, np.nanmax(levels) * 2)  # a prediction has noise alone
    if len(rows) <= 40:
        axes.set_xticks(np.unique([row.l for row in rows]))
    axes.set_xlabel("degree", fontsize=13)
    axes.set_ylabel(f"power  {squared(solution)}", fontsize=13)
    axes.tick_params(labelsize=11)
    axes.legend(frameon=False, fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def plot_power(solution: Any) -> Figure:
    """Power by degree and kind as fitted, for a solution without a covariance.

    Parameters
    ----------
    solution : MatrixFreeSolution
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    l = np.arange(1, solution.modes.lmax + 1)
    for kind in KINDS:
        power = [solution.coefficients.power(kind, int(each)) for each in l]
        axes.semilogy(l, power, "o-", color=_COLOURS[kind], markersize=3, label=_NAMES[kind])
    axes.set_xlabel("degree", fontsize=13)
    axes.set_ylabel("power as fitted  [(µas/yr)²]", fontsize=13)
    axes.legend(frameon=False, fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def plot_correlation(solution: Any) -> Figure:
    """The correlation matrix of the coefficients, colour-blind safe and centred on zero.

    Parameters
    ----------
    solution : Solution
        What was found.

    Returns
    -------
    matplotlib figure
    """
    names = list(solution.names)
    figure, axes = plt.subplots(figsize=(8, 6.8), layout="constrained")
    off = solution.correlation - np.eye(len(names))
    largest = max(float(np.abs(off).max()), 1e-3)
    image = axes.imshow(np.where(np.eye(len(names)) > 0, np.nan, off), cmap="RdBu_r", vmin=-largest, vmax=largest)
    bar = figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label("correlation (diagonal left out)", fontsize=12)
    step = max(1, len(names) // 32)
    axes.set_xticks(range(0, len(names), step), names[::step], rotation=90, fontsize=11 if len(names) < 20 else 8)
    axes.set_yticks(range(0, len(names), step), names[::step], fontsize=11 if len(names) < 20 else 8)
    if isinstance(solution, HarmonicSolution) and len(solution.modes.kinds) == 2:
        half = len(names) / 2 - 0.5
        axes.axhline(half, color="0.4", linewidth=0.8)
        axes.axvline(half, color="0.4", linewidth=0.8)
        axes.set_title(f"{_NAMES['T']} first, then {_NAMES['S']}; {solution.frame}", fontsize=12)
    else:
        axes.set_title(f"{solution.frame} axes", fontsize=12)
    return figure


def plot_residuals(
    solution: HarmonicSolution, field: Field | ScalarField | Parts, *, nside: int | None = None
) -> Figure:
    """Mean normalised residual of each HEALPix pixel, χ² over the components of a source: 1 where the errors are right.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        In the solution's frame.
    nside : int, optional
        Of the pixels; at least ten sources in each on average unless given.

    Returns
    -------
    matplotlib figure
    """
    nside = nside or 2 ** int(np.clip(np.log2(max(1, solution.n_sources / 120)) / 2, 0, 6))
    work = partial(_residual_sums, solution=solution, nside=nside)
    chi2, sources = as_parts(field, Weighed).sum(work, roles=(), words="residuals")
    with np.errstate(divide="ignore", invalid="ignore"):
        decades = np.log10(chi2 / solution.modes.components / sources)
    reach = max(0.3, float(np.nanpercentile(np.abs(decades[np.isfinite(decades)]), 98)))
    axes = sky_axes(solution.frame)
    axes.set_facecolor("0.8")  # no sources is no value
    image = draw_map(axes, decades, cmap="RdBu_r", vmin=-reach, vmax=reach)
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label(
        f"log₁₀ of the mean χ²{'/2' * (solution.modes.components == 2)} of a source (0: errors are right)", fontsize=12
    )
    axes.set_title(f"residuals of {int(sources.sum())} sources, pixels of {58.6 / nside:.1f}°", pad=16)
    return axes.figure


def _residual_sums(field, solution, nside):
    """χ² and sources by pixel."""
    pixel = pixels_of(field.lon, field.lat, nside)
    return np.array([np.bincount(pixel, each, 12 * nside**2) for each in (solution.residuals(field).chi2, None)])
