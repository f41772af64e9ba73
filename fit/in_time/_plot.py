"""Figures of what changes with time (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels
from vsh.tools.types import AxesArray, OnAxes


@apply_style
def plot_in_time(solution: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """√power of every function, a line a degree, beside what noise gives; T above, S below."""
    subplots = panels(ax, 2, 1, size=(WIDTH, 4.6), sharex=True)
    names = solution.functions.names
    x = np.arange(len(names))
    for axes, kind, label in zip(subplots, "TS", ("toroidal", "spheroidal"), strict=True):
        for l in range(1, solution.modes.lmax + 1):
            power, noise, p_value = np.array([solution.power(name, kind, l) for name in names]).T
            is_finite = np.isfinite(p_value)
            if not is_finite.any():
                continue
            colour = COLOURS[(l - 1) % len(COLOURS)]
            axes.plot(x[is_finite], np.sqrt(power[is_finite]), "o-", ms=3, color=colour, label=f"degree {l}")
            axes.plot(x[is_finite], np.sqrt(noise[is_finite]), "_:", ms=8, color=colour, linewidth=0.9)
        axes.set(ylabel=f"{label}, √power  [µas]", ylim=(0, None))
    legend_above(subplots[0], 5, handles=subplots[1].get_legend_handles_labels()[0])
    subplots[1].set_xticks(x, names, rotation=60 if len(names) > 6 else 0, ha="right" if len(names) > 6 else "center")
    subplots[1].set_xlabel("function of time (dashes, dotted: what noise gives)")
    return subplots
