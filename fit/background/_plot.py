"""Figures of backgrounds (matplotlib)."""

import re
import textwrap
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels
from vsh.io.quantities import symbol
from vsh.tools.types import Axes, AxesArray, OnAxes

_LABELS = {"flat": "flat in Ω", "root": "flat in √Ω"}


@apply_style
def plot_wave_limit(limit: Any, *, ax: Axes | None = None) -> Axes:
    """The posteriors of Ω for priors flat in Ω and in √Ω, with the upper limits."""
    (axes,) = panels(ax, size=(WIDTH, 2.9))
    limits = {prior: limit.limit(0.95, prior) for prior in _LABELS}
    largest_omega = 1.35 * limits["flat"]
    omega = np.linspace(0, largest_omega, 1500)[1:]
    for prior in _LABELS:
        density = limit.likelihood(omega) * (1 if prior == "flat" else omega**-0.5)
        density /= np.sum(density) * (omega[1] - omega[0])
        axes.plot(omega, density, color=_colour(prior), label=f"posterior, {_LABELS[prior]}")
    for prior, value in limits.items():
        label = f"< {value:.2g}, {_LABELS[prior]}"
        axes.axvline(value, color=_colour(prior), linestyle="--", linewidth=0.8, label=label)
    highest_density = float(np.max(limit.likelihood(omega) / (np.sum(limit.likelihood(omega)) * (omega[1] - omega[0]))))
    # A prior flat in √Ω rises without end towards zero.
    axes.set(xlim=(0, largest_omega), ylim=(0, 1.6 * highest_density), ylabel="density (dashed: 95 % limits)")
    axes.set_xlabel("$h_{70}^2\\,\\Omega_\\mathrm{GW}$" if limit.hubble == 70 else "$\\Omega_\\mathrm{GW}$")
    legend_above(axes, 2)
    return axes


def _colour(prior):
    return COLOURS[list(_LABELS).index(prior)]


@apply_style
def plot_floor(floor: Any, *, ax: Axes | None = None) -> Axes:
    """The power of a mode of either parity, or of a scalar field, with 68 % intervals."""
    errors = [f"{name} ± {error:.2g} {floor.unit}" for name, error in floor.errors.items()]
    names = [f"odd parity: {errors[0]}", f"even parity: {errors[1]}"] if len(floor.powers) == 2 else ["\n".join(errors)]
    largest_power = max(max(power) for power in floor.powers.values()) or 1.0
    subplots = panels(ax, len(names), 1, size=(WIDTH, 0.5 + 0.75 * len(names)))
    for axes, name, (value, lower, upper) in zip(subplots, names, floor.powers.values(), strict=True):
        axes.hlines(0, lower, upper, color=COLOURS[0], linewidth=2, label="68 %")
        axes.plot(value, 0, "o", color=COLOURS[1], markersize=5, label="median")
        axes.set_title(name, loc="left")
        axes.set_xlim(-0.02 * largest_power, 1.15 * largest_power)
        axes.set(xlabel=f"power of a mode  [({floor.unit})²]" if axes is subplots[-1] else "", yticks=[])
        axes.spines["left"].set_visible(False)
    subplots[0].legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.9))
    return subplots


@apply_style
def plot_cross_powers(powers: Any, *, ax: Axes | None = None) -> Axes:
    """Projections on templates by degree, in their errors with the floor; degree 1 has what is looked for.

    Grey are one and two errors.
    """
    (axes,) = panels(ax, size=(WIDTH, 3.2))
    names = list(dict.fromkeys(powers.templates))
    # Both parts of one template share a colour, so that ten series are five.
    origins = list(dict.fromkeys(name.rpartition(", ")[0] or name for name in names))
    axes.axhspan(-1, 1, color="0.9", linewidth=0)
    axes.axhspan(-2, 2, color="0.95", linewidth=0, zorder=0)
    for k, name in enumerate(names):
        is_shown = np.array([template == name for template in powers.templates]) & (powers.degrees > 1)
        positions = powers.degrees[is_shown] + 0.7 * ((k + 0.5) / len(names) - 0.5)
        deviations = powers.values[is_shown] / powers.errors_with_floor[is_shown]
        origin, _, part = name.rpartition(", ")
        colour = COLOURS[origins.index(origin or name) % len(COLOURS)]
        marker, fill = ("s", "none") if part == "across" else ("o", colour)
        axes.plot(positions, deviations, marker, markersize=3.5, color=colour, markerfacecolor=fill, label=name)
    degrees = np.arange(2, powers.degrees.max() + 1)
    for degree in degrees[1:]:
        axes.axvline(degree - 0.5, color="0.8", linewidth=0.6, linestyle=":")
    axes.axhline(0, color="0.7", linewidth=0.8, zorder=1)
    axes.set(xticks=degrees, xlabel="degree $\\ell$", ylabel="projection on the template / its error")
    legend_above(axes, 2, fontsize=6.5, columnspacing=0.8, handletextpad=0.3)
    return axes


@apply_style
def plot_classes(classes: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Spin and acceleration of each class, component by component, with their errors; all together at the bottom.

    A single class with templates shows the amplitudes of these.
    """
    labels, solutions = list(classes.labels), classes.solutions
    if len(classes) == 1 and classes.templates:
        return _plot_template_amplitudes(classes, ax)
    if len(classes) > 1:
        labels, solutions = [*labels, "together"], [*solutions, classes.together()]
    subplots = panels(ax, 1, 2, size=(WIDTH, 1.3 + 0.36 * len(labels)))
    display_names = {"spin": "rotation", "acceleration": "glide"} if classes.unit == "µas" else {}
    positions, wrapped_labels = np.arange(len(labels)), [_wrap_class_label(label) for label in labels]
    for axes, (kind, (attribute, _)) in zip(subplots, classes.parameters.items(), strict=True):
        series = {"": [solution.mean for solution in solutions]} if attribute == "mean" else {}
        vectors = [] if series else [getattr(solution, attribute) for solution in solutions]
        for k, axis in enumerate("xyz" if vectors else ""):
            series[axis] = [(vector.value[k], vector.sigma[k]) for vector in vectors]
        for k, (axis, pairs) in enumerate(series.items()):
            places, (values, errors) = positions + 0.2 * (k - (len(series) - 1) / 2), zip(*pairs, strict=True)
            axes.errorbar(values, places, xerr=errors, fmt="os^"[k], markersize=3, color=COLOURS[k], label=axis or None)
        axes.axvline(0, color="0.7", linewidth=0.8)
        axes.set_yticks(positions, wrapped_labels if axes is subplots[0] else [""] * len(labels))
        vector_symbol = symbol(f"{attribute}_x").replace("_x", "") if vectors and not display_names else ""
        label = f"{display_names.get(attribute, attribute)} {vector_symbol}\n[{classes.unit}]"
        if len(classes) > 1:
            axes.axhline(len(classes) - 0.5, color="0.7", linewidth=0.8, linestyle=":")  # below it are all together
            label += f"\nagree: p = {classes.equality(kind):.2g}"
        axes.set(ylim=(len(labels) - 0.5, -0.5), xlabel=label)
        axes.xaxis.set_major_locator(MaxNLocator(4, min_n_ticks=3))
    legend_above(subplots[-1], 3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    return subplots


def _wrap_class_label(label):
    """A label of several lines, none of which ends with a sign of comparison."""
    label = re.sub(r"\d+\.\d{4,}", lambda number: f"{float(number[0]):.3g}", label)
    return "\n".join(textwrap.wrap(re.sub("([<≤≥>]) ", "\\1\u00a0", label), 24)).replace("-", "−")


def _plot_template_amplitudes(classes, ax):
    """Amplitudes of the templates, one below the other."""
    (axes,) = panels(ax if ax is None else np.ravel(ax)[:1], size=(WIDTH, 0.9 + 0.26 * len(classes.templates)))
    positions, errors = np.arange(len(classes.templates)), np.sqrt(np.diag(classes.amplitude_covariance))
    axes.errorbar(classes.amplitudes, positions, xerr=errors, fmt="o", color=COLOURS[0])
    axes.axvline(0, color="0.7", linewidth=0.8)
    axes.set_yticks(positions, classes.templates)
    axes.set(ylim=(len(positions) - 0.5, -0.5), xlabel=f"amplitude (rms)  [{classes.unit}]")
    return np.array([axes], dtype=object)
