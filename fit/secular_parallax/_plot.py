"""The flow that was found, on maps (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import ScalarFormatter

from vsh.sky.pixels import centres
from vsh.sky.plot import draw_map, draw_vectors, even_grid, sky_axes
from vsh.types import Figure

_NSIDE = 16


def plot_flow(flow: Any) -> Figure:
    """Velocities on shells: radial ones as colours, tangential ones as arrows; faint where the fit knows nothing.

    Parameters
    ----------
    flow : Flow
        What was found.

    Returns
    -------
    matplotlib figure
    """
    last = flow.modes.radii[-1]
    radii = [radius for radius in (20.0, 40.0, 80.0) if radius <= last] or [float(last)]
    figure = plt.figure(figsize=(9, 4.6 * len(radii)), layout="constrained")
    lon, lat = centres(_NSIDE)
    grid = even_grid(18.0)
    radial = [flow.at(lon, lat, np.full(lon.size, radius))[1] for radius in radii]
    reach = max(float(np.abs(each).max()) for each in radial) or 1.0
    image: Any = None
    for i, (radius, values) in enumerate(zip(radii, radial, strict=True)):
        axes = sky_axes(flow.frame, figure.add_subplot(len(radii), 1, i + 1, projection="hammer"))
        image = draw_map(axes, values, cmap="RdBu_r", vmin=-reach, vmax=reach, alpha=0.85)
        tangential, _ = flow.at(*grid, np.full(grid[0].size, radius))
        draw_vectors(axes, *grid, tangential, scale=2 * reach, color="0.15")
        sure = _known(flow, radius)
        axes.set_title(
            f"{radius:.0f} Mpc/h: {sure:.0%} of the flow's variance is known from the motions", pad=14, fontsize=11
        )
    bar = figure.colorbar(image, ax=figure.axes, orientation="horizontal", shrink=0.5, pad=0.02)
    bar.set_label("velocity away from us [km/s], in the frame of the microwave background", fontsize=11)
    return figure


def _known(flow, radius, places=48):
    """The share of the modes' variance that the fit took away, over directions."""
    lon, lat = even_grid(30.0)
    lon, lat = lon[:: max(1, lon.size // places)], lat[:: max(1, lat.size // places)]
    tangential, radial = flow.modes.at(lon, lat, np.full(lon.size, radius))
    rows = np.concatenate([tangential[0], tangential[1], radial])
    after = np.einsum("ni,ij,nj->n", rows, flow.covariance, rows)
    return max(0.0, 1 - after.sum() / np.sum(rows**2))


def plot_forecast(forecast: Any) -> Figure:
    """Errors of H0 against the redshift limit.

    Parameters
    ----------
    forecast : Forecast
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    count = len(forecast.catalogues)
    figure, panels = plt.subplots(
        1, count, figsize=(4.2 * count + 1.2, 4), sharey=True, layout="constrained", squeeze=False
    )
    colours = ("#7f7f7f", "#0b5394", "#38761d", "#c55a11", "#741b47", "#b8860b")
    for axes, name, errors in zip(panels[0], forecast.catalogues, forecast.hubble, strict=True):
        for known, each, colour in zip(forecast.known, errors.T, colours, strict=True):
            style = "--" if known == "independent" else "-"
            axes.plot(forecast.limits, each, marker="o", color=colour, linestyle=style, label=known)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.yaxis.set_minor_formatter(ScalarFormatter())
        axes.set_xticks(forecast.limits)
        axes.set_title(name, fontsize=12)
        axes.set_xlabel("galaxies with z below", fontsize=12)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0, 0].set_ylabel("error of H0  [km/s/Mpc]", fontsize=12)
    panels[0, -1].legend(frameon=False, fontsize=10)
    return figure
