"""Surveys side by side (matplotlib)."""

from textwrap import fill
from typing import Any

import numpy as np

from study.forecast._surveys import QUANTITIES
from vsh.figures.plot import COLOURS, WIDTH, log_ticks, panels, styled
from vsh.tools.types import AxesArray, OnAxes

_SHOWN = ("spin", "acceleration", "direction", "r0", "waves", "shear", "velocity", "hubble")


@styled
def plot_forecast(forecast: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Eight quantities by survey, and what floor and flows leave of them."""
    drawn = panels(ax, 4, 2, size=(WIDTH, 6.4), sharex=True)
    names = list(forecast.surveys)
    place = np.arange(len(names))
    for axes, name in zip(drawn, _SHOWN, strict=True):
        words, unit = QUANTITIES[name]
        values = np.array([forecast.values[survey][name] for survey in names])
        seen = np.isfinite(values)
        both = [further for further in (f"{name}_floor", f"{name}_flows") if further in QUANTITIES]
        alone = "noise alone" if both else None
        axes.scatter(place[seen], values[seen], s=10, color=COLOURS[0], zorder=3, label=alone)
        for further in both:
            more = np.array([forecast.values[survey][further] for survey in names])
            label = QUANTITIES[further][0].strip().split(", ")[-1]
            axes.scatter(place, more, marker="_", s=70, linewidths=1.4, color=COLOURS[1], label=label)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=5.5, loc="best", handletextpad=0.1)
        if seen.any():
            axes.set_yscale("log")
            axes.margins(y=0.15)
            log_ticks(axes.yaxis, *axes.get_ylim())
        axes.set_xlim(-0.5, len(names) - 0.5)
        axes.grid(axis="y", color="0.9", linewidth=0.4)
        axes.set_xticks(place, names, rotation=55, ha="right", rotation_mode="anchor")
        axes.set_title(fill(words.strip(), 26), fontsize=6.5)
        axes.set_ylabel(f"[{unit}]" if unit else "")
    return drawn
