"""Figures of a joint solution (matplotlib)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from sim.agis.results._solution import AgisSolution
from sim.agis.results._statistics import ratio_by
from vsh.sky.pixels import pixels_of
from vsh.sky.plot import draw_map, sky_axes
from vsh.types import ArrayLike, Figure, FloatArray

_COLOURS = ("#0b5394", "#c55a11", "#38761d", "#7f6000", "#741b47")
_PARAMETERS = ("α*", "δ", "ϖ", "µα*", "µδ")


def plot_convergence(solution: AgisSolution, stop: float = 0.05) -> Figure:
    """How far the low degrees are from where they end, iteration by iteration. Returns the figure.

    Parameters
    ----------
    solution : AgisSolution
        With its history.
    stop : float
        The rule, in formal errors.

    Returns
    -------
    Figure
    """
    away = np.abs(solution.history - solution.history[-1])[:-1] / np.sqrt(np.diag(solution.formal_low))
    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    steps = np.arange(1, len(away) + 1)
    for degree, colour in zip(range(1, solution.modes.lmax + 1), _COLOURS, strict=False):
        most = away[:, solution.modes.degrees == degree].max(axis=1)
        ax.semilogy(steps, np.where(most > 0, most, np.nan), color=colour, label=f"degree {degree}")
    size = solution.updates / np.sqrt(np.median(solution.formal[solution.solved, 2, 2]))
    ax.semilogy(steps[: len(size)], size[: len(away)], color="0.6", linestyle="--", label="parallax updates, rms")
    ax.axhline(stop, color="0.3", linewidth=0.8)
    ax.annotate(f"{stop:g}", (1, stop), xytext=(0, 3), textcoords="offset points", color="0.3", fontsize=11)
    ax.legend(frameon=False, fontsize=11, ncols=4, loc="lower left", bbox_to_anchor=(-0.05, 1.0))
    return _finished(figure, ax, "iteration", "distance from the last, in formal errors")


def plot_errors_by_magnitude(solution: AgisSolution, magnitude: ArrayLike, sources: ArrayLike | None = None) -> Figure:
    """True over formal errors of the five parameters by magnitude, from this draw of the noise. Returns the figure.

    Parameters
    ----------
    solution : AgisSolution
        Of noise alone.
    magnitude : (n,) array
        G of all sources.
    sources : mask, optional
        Which are looked at; all unless given.

    Returns
    -------
    Figure
    """
    kept = solution.solved if sources is None else solution.solved & np.asarray(sources)
    g = np.asarray(magnitude)[kept]
    edges = np.arange(np.floor(2 * g.min()) / 2, np.ceil(2 * g.max()) / 2 + 0.5, 0.5)
    group = np.clip(np.searchsorted(edges, g, side="right") - 1, 0, len(edges) - 2)
    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for column, name in enumerate(_PARAMETERS):
        ratio, counts = ratio_by(solution.sources[kept, column], np.sqrt(solution.formal[kept, column, column]), group, len(edges) - 1)  # fmt: skip
        ax.errorbar((edges[:-1] + edges[1:]) / 2, ratio, ratio / np.sqrt(2 * np.maximum(counts, 1)), marker="o", markersize=4, label=name, color=_COLOURS[column])  # fmt: skip
    ax.axhline(1, color="0.3", linewidth=0.8)
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if low <= tick <= high]
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.set_yticks([], minor=True)
    ax.legend(frameon=False, fontsize=11)
    return _finished(figure, ax, "G", "true / formal error")


def plot_correlation(angle: FloatArray, correlation: FloatArray, pairs: FloatArray, draws: int = 1) -> Figure:
    """Correlation of errors by the angle between two sources. Returns the figure.

    Parameters
    ----------
    angle : (b + 1,) array
        Edges of the bins. [rad]
    correlation, pairs : (b,) arrays
        Of `correlation_by_angle`.
    draws : int
        Of the noise.

    Returns
    -------
    Figure
    """
    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    middle = np.degrees((angle[:-1] + angle[1:]) / 2)
    ax.errorbar(
        middle, correlation, 1 / np.sqrt(np.maximum(pairs, 1) * draws), marker="o", color=_COLOURS[0], capsize=2
    )
    ax.axhline(0, color="0.3", linewidth=0.8)
    if middle[-1] > 30 * middle[0]:
        ax.set_xscale("log")
    return _finished(figure, ax, "angle between sources [deg]", "correlation of parallax errors")


def plot_ratio_map(solution: AgisSolution, nside: int = 8, sources: ArrayLike | None = None) -> Figure:
    """True over formal errors of the motions over the sky, from this draw of the noise. Returns the figure.

    Parameters
    ----------
    solution : AgisSolution
        Of noise alone.
    nside : int
        Of the HEALPix pixels.
    sources : mask, optional
        Which are looked at; all unless given.

    Returns
    -------
    Figure
    """
    kept = solution.solved if sources is None else solution.solved & np.asarray(sources)
    pixel = pixels_of(solution.lon[kept], solution.lat[kept], nside)
    squares = []
    for column in (3, 4):
        sigma = np.sqrt(solution.formal[kept, column, column])
        squares.append(ratio_by(solution.sources[kept, column], sigma, pixel, 12 * nside**2)[0] ** 2)
    ratio = np.sqrt(np.mean(squares, axis=0))
    axes = sky_axes(solution.frame)
    seen = ratio[np.isfinite(ratio)]
    image = draw_map(axes, ratio, cmap="viridis", vmin=min(1.0, seen.min()), vmax=np.percentile(seen, 98))
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label("true / formal error of the motions", fontsize=12)
    return axes.figure


def _finished(figure, ax, x, y):
    ax.set_xlabel(x, fontsize=13)
    ax.set_ylabel(y, fontsize=13)
    ax.tick_params(labelsize=11)
    ax.spines[["top", "right"]].set_visible(False)
    return figure
