"""Figures of a joint solution (matplotlib)."""

import numpy as np

from sim.agis._results import AgisSolution
from vsh.figures.plot import COLOURS, apply_style, legend_above, panels
from vsh.tools.types import ArrayLike, Axes

_PARAMETERS = ("α*", "δ", "ϖ", "µα*", "µδ")
_MARKS = "os^Dv"


def _error_ratios(errors, sigma, group, n_groups):
    """True over formal errors of groups of sources, the rms of error over standard error; and how many they are."""
    counts = np.bincount(group, minlength=n_groups)
    with np.errstate(invalid="ignore"):  # of groups without a source
        return np.sqrt(np.bincount(group, (errors / sigma) ** 2, n_groups) / counts), counts


@apply_style
def plot_convergence(solution: AgisSolution, *, ax: Axes | None = None) -> Axes:
    """Plot the distance of the low degrees from where they end, iteration by iteration."""
    distance = np.abs(solution.history - solution.history[-1])[:-1] / np.sqrt(np.diag(solution.formal_low))
    (axes,) = panels(ax)
    steps = np.arange(1, len(distance) + 1)
    for degree, colour in zip(range(1, solution.modes.lmax + 1), COLOURS, strict=False):
        maximum = distance[:, solution.modes.degrees == degree].max(axis=1)
        axes.semilogy(steps, np.where(maximum > 0, maximum, np.nan), color=colour, label=f"degree {degree}")
    size = solution.updates / np.sqrt(np.median(solution.formal[solution.solved, 2, 2]))
    axes.semilogy(steps[: len(size)], size[: len(distance)], color="0.6", linestyle="--", label="parallax updates, rms")
    axes.axhline(0.05, color="0.3", linewidth=0.6, label="0.05: converged")
    axes.set(xlabel="iteration", ylabel="distance from the last [formal errors]")
    legend_above(axes, 2)
    return axes


@apply_style
def plot_errors_by_magnitude(solution: AgisSolution, magnitude: ArrayLike, *, ax: Axes | None = None) -> Axes:
    """True over formal errors of the five parameters by magnitude, from this draw of the noise."""
    selection = solution.solved
    g = np.asarray(magnitude)[selection]
    edges = np.arange(np.floor(2 * g.min()) / 2, np.ceil(2 * g.max()) / 2 + 0.5, 0.5)
    group = np.clip(np.searchsorted(edges, g, side="right") - 1, 0, len(edges) - 2)
    (axes,) = panels(ax)
    for column, name in enumerate(_PARAMETERS):
        sigma = np.sqrt(solution.formal[selection, column, column])
        ratio, counts = _error_ratios(solution.sources[selection, column], sigma, group, len(edges) - 1)
        axes.errorbar(
            (edges[:-1] + edges[1:]) / 2 + 0.03 * (column - 2),
            ratio,
            ratio / np.sqrt(2 * np.maximum(counts, 1)),
            marker=_MARKS[column],
            label=name,
            color=COLOURS[column],
        )
    axes.axhline(1, color="0.3", linewidth=0.6)
    axes.set_yscale("log")
    lower, upper = axes.get_ylim()
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if lower <= tick <= upper]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set(xlabel="G  [mag]", ylabel="true / formal error")
    legend_above(axes, 5)
    return axes
