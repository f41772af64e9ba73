"""Surveys side by side (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from study.forecast._surveys import QUANTITIES
from vsh.types import Figure

_SHOWN = ("spin", "acceleration", "direction", "r0", "waves", "shear", "velocity", "hubble")


def plot_forecast(found: Any) -> Figure:
    """Eight quantities by survey, and what floor and flows leave of them.

    Parameters
    ----------
    found : Forecast
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    figure, panels = plt.subplots(2, 4, figsize=(13, 6.4), layout="constrained")
    names = list(found.surveys)
    for axes, name in zip(panels.ravel(), _SHOWN, strict=True):
        words, unit = QUANTITIES[name]
        values = np.array([found.values[survey][name] for survey in names])
        place = np.arange(len(names))
        seen = np.isfinite(values)
        axes.scatter(place[seen], values[seen], s=70, color="#0b5394", zorder=3)
        for further in (f"{name}_floor", f"{name}_flows"):
            if further in QUANTITIES:
                more = np.array([found.values[survey][further] for survey in names])
                axes.scatter(
                    place,
                    more,
                    marker="_",
                    s=380,
                    linewidths=2.5,
                    color="#c55a11",
                    label=QUANTITIES[further][0].strip(),
                )
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, fontsize=9, loc="best")
        if seen.any():
            axes.set_yscale("log")
        axes.set_xlim(-0.5, len(names) - 0.5)
        axes.grid(axis="y", color="0.9")
        axes.set_xticks(place, names, rotation=35, ha="right", fontsize=10)
        axes.set_title(f"{words.strip()}{f'  [{unit}]' if unit else ''}", fontsize=11)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
