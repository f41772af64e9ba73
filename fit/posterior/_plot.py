"""Figures of a posterior (corner, matplotlib)."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from fit.posterior._priors import UNITS
from fit.posterior._sampling import Normal
from vsh.figures.plot import COLOURS, WIDTH, apply_style, figure_of, panels
from vsh.io.quantities import symbol
from vsh.sky.frames import title_of
from vsh.tools.digits import decimals_of_error
from vsh.tools.errors import ParameterError
from vsh.tools.printing import import_quietly
from vsh.tools.types import AxesArray, OnAxes

#: The data say something of a quantity if they take a tenth off the width of its prior.
_NARROWED_SHARE = 0.9


def format_quantity_label(name: str) -> str:
    """Format a quantity's name with its unit, as on an axis."""
    unit = f"\n[{UNITS[name]}]" if UNITS.get(name) else ""
    return symbol(name) + unit


@apply_style
def plot_corner(
    posterior: Any,
    names: Sequence[str] | None = None,
    *,
    truths: Mapping[str, float] | None = None,
    ax: OnAxes | None = None,
) -> AxesArray:
    """Plot every pair of quantities, with 68 and 95 % contours."""
    samples = posterior.samples
    quantities = list(samples) if names is None else list(names)
    invalid_names = [name for name in (*quantities, *(truths or {})) if name not in samples]
    if invalid_names:
        raise ParameterError(f"no quantity is called {', '.join(invalid_names)}; there are {', '.join(samples)}")
    if names is None:
        varied = [name for name in quantities if not name.startswith(("omega_", "speed")) and np.ptp(samples[name]) > 0]
        quantities = [
            name for name in varied if np.std(samples[name]) < _NARROWED_SHARE * _find_prior_sigma(posterior, name)
        ] or varied
    if not quantities:
        raise ParameterError("no quantity was free: there is nothing to draw")
    columns = np.stack([samples[name] for name in quantities], axis=1)
    k = len(quantities)
    truth_values = [(truths or {}).get(name) for name in quantities]
    size = max(WIDTH, 0.95 * k + 0.6)
    figure = plt.figure(figsize=(size, size), layout="none") if ax is None else figure_of(panels(ax, k, k))
    with plt.rc_context({"axes.spines.top": True, "axes.spines.right": True}):
        import_quietly("corner").corner(
            columns,
            fig=figure,
            labels=[format_quantity_label(name) for name in quantities],
            levels=(0.683, 0.954),
            truths=truth_values,
            truth_color=COLOURS[1],
            quantiles=(0.15865525, 0.5, 0.84134475),
            label_kwargs={"fontsize": 8},
            color=COLOURS[0],
            plot_datapoints=False,
            smooth=1.0,
            bins=30,
            max_n_ticks=3,
            labelpad=0.12,
            range=[_find_axis_range(*pair) for pair in zip(columns.T, truth_values, strict=True)],
        )
    if ax is None:
        edge = 0.8 / size  # else corner cuts labels off
        figure.subplots_adjust(left=edge, bottom=edge, right=1 - 0.1 / size, top=1 - 0.35 / size)
    subplots = np.array(figure.axes[-k * k :], dtype=object).reshape(k, k)
    for axes, name, values in zip(subplots.diagonal(), quantities, columns.T, strict=True):
        axes.set_title(f"{symbol(name)} = {_format_median_and_errors(values)}", fontsize=7)
    for axes in subplots[np.tril_indices(k)]:  # the end ticks of two neighbours would touch
        axes.xaxis.set_major_locator(MaxNLocator(3, prune="both", min_n_ticks=2))
    for axes in subplots[np.tril_indices(k, -1)]:
        axes.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    _draw_hubble_prior(subplots, posterior, quantities)
    handles = [Line2D([], [], color=COLOURS[1], label="truth")] * any(value is not None for value in truth_values)
    if "H0" in quantities and getattr(posterior, "model", None) is not None:
        handles.append(Line2D([], [], color="0.4", linestyle="--", linewidth=0.8, label="prior on $H_0$"))
    if handles and k > 1:
        figure.legend(handles=handles, loc="upper right", bbox_to_anchor=(0.98, 0.93))
    figure.suptitle(f"{title_of(posterior.frame)} axes, velocity toward the apex", x=0.98, ha="right")
    return subplots


def _find_prior_sigma(posterior, name):
    """Find the standard deviation of a Gaussian prior on a quantity; inf of any other, and of samples with no model."""
    if getattr(posterior, "model", None) is None:
        return np.inf
    priors, (vector, _, axis) = posterior.model.priors, name.rpartition("_")
    if vector == "v" and priors.velocity.gaussian and np.linalg.det(priors.velocity.precision) > 0:
        return np.sqrt(np.linalg.inv(priors.velocity.precision).diagonal()["xyz".index(axis)])
    if vector == "a" and priors.acceleration is not None:
        return priors.acceleration.sigma["xyz".index(axis)]
    prior = priors.hubble if name == "H0" else priors.free.get(name)
    return prior.sigma if isinstance(prior, Normal) else np.inf


def _format_median_and_errors(values):
    """Format the median with the way to both ends of its 68 %, two digits of the smaller."""
    lower, middle, upper = np.quantile(values, (0.15865525, 0.5, 0.84134475))
    digits = decimals_of_error(min(middle - lower, upper - middle))
    return rf"${middle:.{digits}f}^{{+{upper - middle:.{digits}f}}}_{{-{middle - lower:.{digits}f}}}$"


def _find_axis_range(values, truth):
    """Find the range of all but the farthest thousandth of the samples, and of the truth; below zero if some are."""
    lower, upper = np.quantile(values, [0.0005, 0.9995])
    if truth is not None:
        lower, upper = min(lower, truth), max(upper, truth)
    margin = 0.05 * (upper - lower) or 1.0
    return lower - margin if min(lower, values.min()) < 0 else max(lower - margin, 0.0), upper + margin


def _draw_hubble_prior(subplots, posterior, names):
    """Draw the prior on H0 over the histogram of its samples."""
    model = getattr(posterior, "model", None)
    if model is None or "H0" not in names:
        return
    index = names.index("H0")
    axes = subplots[index, index]
    lower, upper = axes.get_xlim()
    x = np.linspace(lower, upper, 200)
    density = np.exp(model.priors.hubble.log(x))
    if density.max() > 0:
        axes.plot(x, density / density.max() * 0.9 * axes.get_ylim()[1], color="0.4", linestyle="--", linewidth=0.8)


@apply_style
def plot_trace(posterior: Any, n_shown: int = 10, *, ax: OnAxes | None = None) -> AxesArray:
    """Coordinates of some walkers against steps; the burn-in shaded, R̂ and the effective size beside each."""
    names, chain = posterior.model.names, posterior.chain
    subplots = panels(ax, len(names), 1, size=(WIDTH, 0.75 * len(names) + 0.5), sharex=True)
    walker_stride, step_stride = max(1, chain.shape[1] // n_shown), max(1, len(chain) // 400)
    r_hat, size, steps = posterior.r_hat, posterior.effective_size, np.arange(0, len(chain), step_stride)
    for axes, name, values in zip(subplots, names, np.moveaxis(chain, 2, 0), strict=True):
        shown_chains = values[::step_stride, ::walker_stride]
        axes.plot(steps, shown_chains, color=COLOURS[0], alpha=0.4, linewidth=0.4, rasterized=True)
        if posterior.burn_in:
            axes.axvspan(0, posterior.burn_in, color="0.85", zorder=0)
        axes.set_ylabel(format_quantity_label(name) if name in UNITS else symbol(name))
        axes.set_title(
            f"R̂ = {r_hat[name]:.3f}, effective size {float(f'{size[name]:.2g}'):.0f}", loc="right", fontsize=6.5, pad=2
        )
    subplots[-1].set_xlabel(f"step{' (shaded: left out)' if posterior.burn_in else ''}")
    return subplots


@apply_style
def plot_marginals(grid: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """The marginal density of each quantity on a grid."""
    subplots = panels(ax, len(grid.names), 1, size=(WIDTH, 1.9 * len(grid.names)))
    for axes, name in zip(subplots, grid.names, strict=True):
        values, probabilities = grid.marginal(name)
        axes.plot(values, probabilities / (values[1] - values[0]), color=COLOURS[0])
        axes.set(xlabel=format_quantity_label(name).replace("\n", "  "), ylabel="density", ylim=(0, None))
    return subplots
