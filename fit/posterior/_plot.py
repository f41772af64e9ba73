"""Figures of a posterior (corner, matplotlib)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fit.posterior._priors import UNITS
from vsh.system.quiet import import_quietly
from vsh.types import Figure

corner = import_quietly("corner")

_LABELS = {
    "v_x": "$v_x$", "v_y": "$v_y$", "v_z": "$v_z$", "speed": "$|v|$", "H0": "$H_0$", "peculiar_dispersion": r"$\sigma_{\rm pec}$",
    "excess_noise": r"$\sigma_{\rm excess}$", "outlier_fraction": "outliers", "a_x": r"$\tilde a_x$",
    "a_y": r"$\tilde a_y$", "a_z": r"$\tilde a_z$",
}  # fmt: skip


def label(name: str) -> str:
    """A quantity's name with its unit, as on an axis.

    Parameters
    ----------
    name : str
        Of a quantity.
    """
    unit = f"\n[{UNITS[name]}]" if UNITS.get(name) else ""
    return _LABELS.get(name, name) + unit


def plot_corner(posterior: Any, names: Sequence[str] | None = None) -> Figure:
    """Every pair of quantities, with 68 and 95 % contours.

    Parameters
    ----------
    posterior : Posterior or Samples
        What to draw.
    names : sequence of str, optional
        Which quantities.
    """
    samples = posterior.samples
    if names is None:
        names = [name for name in samples if not name.startswith(("omega_", "speed"))]
    data = np.stack([samples[name] for name in names], axis=1)
    figure = corner.corner(
        data, labels=[label(name) for name in names], levels=(0.683, 0.954), quantiles=(0.15865525, 0.5, 0.84134475),
        show_titles=True, titles=[_LABELS.get(name, name) for name in names], title_fmt=".3g", title_kwargs={"fontsize": 10}, label_kwargs={"fontsize": 13},
        color="#0b5394", plot_datapoints=False, smooth=1.0, bins=30, max_n_ticks=4,
    )  # fmt: skip
    figure.subplots_adjust(left=0.1, bottom=0.1)  # else corner cuts the labels off
    _draw_prior(figure, posterior, names)
    figure.suptitle(f"{posterior.frame} axes, velocity toward the apex", x=0.98, ha="right", fontsize=13)
    return figure


def _draw_prior(figure, posterior, names):
    """The prior on H0 over the histogram of its samples."""
    model = getattr(posterior, "model", None)
    if model is None or "H0" not in names:
        return
    place = list(names).index("H0")
    axes = np.array(figure.axes).reshape(len(names), len(names))[place, place]
    x = np.linspace(*axes.get_xlim(), 200)
    density = np.exp(model.priors.hubble.log(x))
    if density.max() > 0:
        axes.plot(x, density / density.max() * 0.9 * axes.get_ylim()[1], color="#c55a11", linestyle="--", linewidth=1)


def plot_trace(posterior: Any, n_shown: int = 40) -> Figure:
    """Coordinates of the sampler against steps, some walkers; the burn-in shaded.

    Parameters
    ----------
    posterior : Posterior
        What to draw.
    n_shown : int
        Of the walkers.
    """
    names, chain = posterior.model.names, posterior.chain
    figure, rows = plt.subplots(
        len(names), 1, sharex=True, figsize=(9, 1.3 * len(names) + 0.8), layout="constrained", squeeze=False
    )
    each, every = max(1, chain.shape[1] // n_shown), max(1, len(chain) // 2000)
    for axes, name, values in zip(rows[:, 0], names, np.moveaxis(chain, 2, 0), strict=True):
        axes.plot(np.arange(0, len(chain), every), values[::every, ::each], color="#0b5394", alpha=0.2, linewidth=0.5)
        axes.axvspan(0, posterior.burn_in, color="0.85", zorder=0)
        axes.set_ylabel(label(name) if name in UNITS else f"${name}$")
        axes.spines[["top", "right"]].set_visible(False)
    rows[-1, 0].set_xlabel("step (shaded: left out)")
    return figure


def plot_marginals(grid: Any) -> Figure:
    """The marginal density of each quantity on a grid.

    Parameters
    ----------
    grid : GridPosterior
        What to draw.
    """
    figure, panels = plt.subplots(
        1, len(grid.names), figsize=(5.5 * len(grid.names), 4), layout="constrained", squeeze=False
    )
    for axes, name in zip(panels[0], grid.names, strict=True):
        x, p = grid.marginal(name)
        axes.plot(x, p / (x[1] - x[0]), color="#0b5394")
        axes.set_xlabel(label(name).replace("\n", "  "), fontsize=13)
        axes.set_ylabel("density", fontsize=13)
        axes.set_ylim(bottom=0)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
