"""Surveys side by side (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels, set_log_ticks
from vsh.tools.types import AxesArray, OnAxes

#: What each panel shows: its label, and quantities with what they are.
_PANELS = (
    ("ã  [µas/yr]", {"acceleration": "noise alone", "acceleration_floor": "with the systematic floor"}),
    ("$H_0$  [km/s/Mpc]", {"hubble": "noise alone", "hubble_flows": "flows fitted"}),
)


@apply_style
def plot_forecast(forecast: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Errors of the acceleration and of H0 by survey: of noise alone, and with what nature adds."""
    names = list(forecast.surveys)
    axes_array = panels(ax, 1, 2, size=(WIDTH, 1.1 + 0.3 * len(names)), sharey=True)
    rows = np.arange(len(names))
    for axes, (label, quantities) in zip(axes_array, _PANELS, strict=True):
        for k, (quantity, description) in enumerate(quantities.items()):
            errors = np.array([forecast.values[survey][quantity] for survey in names])
            axes.plot(errors, rows + 0.16 * (k - 0.5), "os"[k], color=COLOURS[k], markersize=4, label=description)
        axes.set_xscale("log")
        axes.margins(x=0.15)
        set_log_ticks(axes.xaxis, *axes.get_xlim())
        axes.grid(axis="y", color="0.9", linewidth=0.4)
        axes.set(ylim=(len(names) - 0.5, -0.5), xlabel="error of " + label.replace("  ", "\n"))
        axes.set_yticks(rows, names)
        legend_above(axes, 1)
    return axes_array
