"""Figures of correlations, influence and leakage (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import MaxNLocator

from fit.correlation._parameters import symbol
from vsh.field import Field
from vsh.sky.plot import draw_map, draw_sources, draw_vectors, even_grid, sky_axes
from vsh.types import Figure, FloatArray

_MAP = "RdBu_r"  # diverging, told apart by the colour-blind, centred on zero


def plot_matrix(correlations: Any) -> Figure:
    """The matrix of one catalogue, or of two in its two triangles, with numbers where there is room.

    Parameters
    ----------
    correlations : CorrelationMatrices
        One or two catalogues.
    """
    matrix, names = correlations.combined(), [symbol(name) for name in correlations.names]
    k = len(names)
    figure, axes = plt.subplots(figsize=(9, 7.6), layout="constrained")
    off = np.where(np.eye(k) > 0, np.nan, matrix)
    reach = max(float(np.nanmax(np.abs(off))), 1e-3)
    axes.set_facecolor("0.85")
    image = axes.imshow(off, cmap=_MAP, vmin=-reach, vmax=reach)
    step = max(1, k // 32)
    size = 15 if k <= 9 else 11 if k <= 20 else 8
    axes.set_xticks(range(0, k, step), names[::step], rotation=0 if k <= 9 else 90, fontsize=size)
    axes.set_yticks(range(0, k, step), names[::step], fontsize=size)
    axes.tick_params(length=0)
    if k <= 12:
        for (row, column), value in np.ndenumerate(matrix):
            if row != column:
                dark = abs(value) > 0.6 * reach
                axes.text(
                    column, row, f"{value:+.2f}", ha="center", va="center", fontsize=11, color="w" if dark else "k"
                )
    if len(correlations.labels) > 1:
        axes.plot([-0.5, k - 0.5], [-0.5, k - 0.5], color="k", linewidth=1)
        axes.set_title(f"above the diagonal: {correlations.labels[0]}; below: {correlations.labels[1]}", fontsize=14)
    else:
        axes.set_title(correlations.labels[0], fontsize=14)
    bar = figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label(f"correlation ({correlations.frame} axes)", fontsize=13)
    return figure


def plot_influence(values: FloatArray, field: Field, title: str, label: str, *, max_sources: int = 3000) -> Figure:
    """A map of influence on the sky with the sources.

    Parameters
    ----------
    values : (12 nside²,) array
        From `fit.correlation.influence_map` or `gain_of_sources`.
    field : Field
        The sources, in the frame of the map.
    title, label : str
        Of the figure.
    max_sources : int
        How many dots at most.

    Returns
    -------
    Figure
    """
    axes = sky_axes(field.frame)
    reach = float(np.percentile(np.abs(values[values != 0]), 99)) if np.any(values) else 1.0
    image = draw_map(axes, values, cmap=_MAP, vmin=-reach, vmax=reach)
    draw_sources(axes, field.lon, field.lat, max_sources=max_sources, s=2, color="0.15", alpha=0.5)
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06, extend="both")
    bar.set_label(label, fontsize=12)
    bar.ax.tick_params(labelsize=11)
    bar.locator = MaxNLocator(5)
    bar.update_ticks()
    axes.set_title(title, pad=16, fontsize=14)
    return axes.figure


def plot_shares(keep: FloatArray, frame: str) -> Figure:
    """A map of the share of the weight that is kept in each pixel, (12 nside²,).

    Parameters
    ----------
    keep : (12 nside²,) array
        Shares, 0 to 1.
    frame : str
        "icrs", "galactic" or "ecliptic".
    """
    axes = sky_axes(frame)
    axes.set_facecolor("0.85")
    image = draw_map(axes, keep, cmap="viridis", vmin=0, vmax=1)
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label("share of the weight that is kept", fontsize=12)
    return axes.figure


def plot_leakage(leakage: Any) -> Figure:
    """The leakage matrix: what one unit of each unmodelled coefficient does to the fitted ones.

    Parameters
    ----------
    leakage : Leakage
        What to draw.
    """
    rows, columns = leakage.matrix.shape
    figure, axes = plt.subplots(figsize=(min(16, 4 + 0.12 * columns), min(12, 3 + 0.3 * rows)), layout="constrained")
    reach = max(float(np.abs(leakage.matrix).max()), 1e-3)
    image = axes.imshow(leakage.matrix, cmap=_MAP, vmin=-reach, vmax=reach, aspect="auto")
    # Too many columns to name each: the first of every degree, and a line before it.
    first = [i for i, name in enumerate(leakage.unmodelled_names) if name[1:].split(",")[1].startswith("0")]
    for i in first[1:]:
        axes.axvline(i - 0.5, color="0.5", linewidth=0.8)
    axes.set_xticks(first, [f"{name[0]}, l = {name[2:].split(',')[0]}" for name in np.array(leakage.unmodelled_names)[first]],
                    rotation=45, ha="left", rotation_mode="anchor", fontsize=11)  # fmt: skip
    axes.xaxis.tick_top()
    each = max(1, rows // 40)
    axes.set_yticks(range(0, rows, each), leakage.names[::each], fontsize=11 if rows <= 20 else 8)
    axes.set_xlabel("coefficients that are not fitted", fontsize=13)
    axes.set_ylabel("fitted", fontsize=13)
    bar = figure.colorbar(image, ax=axes)
    bar.set_label(f"bias per unit ({leakage.frame} axes)", fontsize=12)
    return figure


def plot_eigenmodes(eigen: Any, n_fields: int = 2) -> Figure:
    """The worst and the best measured fields of a sky, as arrows.

    Parameters
    ----------
    eigen : Eigenmodes
        What to draw.
    n_fields : int
        How many of the worst and of the best.
    """
    count = min(n_fields, len(eigen.fields) // 2)
    figure = plt.figure(figsize=(8 * count, 9.6), layout="constrained")
    lon, lat = even_grid(15.0)
    chosen = [*range(count), *range(len(eigen.fields) - count, len(eigen.fields))]
    for place, i in enumerate(chosen):
        axes = sky_axes(eigen.frame, figure.add_subplot(2, count, place + 1, projection="hammer"))
        draw_vectors(axes, lon, lat, eigen.fields[i].at(lon, lat), color="#c55a11" if place < count else "#0b5394")
        words = "worst" if place < count else "best"
        error = 1 / np.sqrt(eigen.information[i])
        axes.set_title(f"{words} measured: {error:.2f} times the error on a uniform sky", pad=14, fontsize=13)
    return figure
