"""Surveys side by side (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels, set_log_ticks
from vsh.tools.types import AxesArray, OnAxes

#: What each panel shows: its label, and quantities with what they are.
_SHOWN = (
    ("acceleration  [µas/yr]", {"acceleration": "noise alone", "acceleration_floor": "with the systematic floor"}),
    ("$H_0$  [km/s/Mpc]", {"hubble": "noise alone", "hubble_flows": "flows fitted"}),
)


@apply_style
def plot_forecast(forecast: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Errors of the acceleration and of H0 by survey: of noise alone, and with what nature adds."""
    axes_array = panels(ax, 1, 2, size=(WIDTH, 2.7))
    names = list(forecast.surveys)
    for axes, (label, quantities) in zip(axes_array, _SHOWN, strict=True):
        for k, (quantity, description) in enumerate(quantities.items()):
            values = np.array([forecast.values[survey][quantity] for survey in names])
            positions = np.arange(len(names)) + 0.16 * (k - 0.5)
            axes.plot(positions, values, "os"[k], color=COLOURS[k], markersize=4, label=description)
        axes.set_yscale("log")
        axes.margins(y=0.15)
        set_log_ticks(axes.yaxis, *axes.get_ylim())
        axes.set_xlim(-0.5, len(names) - 0.5)
        axes.grid(axis="y", color="0.9", linewidth=0.4)
        axes.set_xticks(range(len(names)), names, rotation=90)
        axes.set_ylabel(f"standard error of {label}")
        legend_above(axes, 1)
    return axes_array
