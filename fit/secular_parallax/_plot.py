"""The flow that was found, on maps (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import (
    COLOURS,
    DIVERGING,
    WIDTH,
    apply_style,
    arrow_grid,
    draw_arrow_key,
    draw_map,
    draw_vectors,
    even_grid,
    panels,
    set_log_ticks,
    sky_axes,
)
from vsh.sky.pixels import centres
from vsh.tools.types import AxesArray, OnAxes

_NSIDE = 16
#: An arrow as long as the largest radial velocity. [deg]
_LONGEST = 16.0


@apply_style
def plot_flow(flow: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Velocities on shells: radial ones as colours, tangential ones as arrows; faint where the fit knows nothing."""
    outer_radius = flow.modes.radii[-1]
    radii = [radius for radius in (20.0, 40.0, 80.0) if radius <= outer_radius] or [float(outer_radius)]
    subplots = panels(ax, len(radii), 1, size=(WIDTH, 2.15 * len(radii) + 0.5))
    lon, lat = centres(_NSIDE)
    radial_velocities = [flow.at(lon, lat, np.full(lon.size, radius))[1] for radius in radii]
    reach = max(float(np.abs(velocities).max()) for velocities in radial_velocities) or 1.0
    image: Any = None
    for i, (radius, radial_velocity) in enumerate(zip(radii, radial_velocities, strict=True)):
        axes = subplots[i] = sky_axes(flow.frame, subplots[i])
        image = draw_map(axes, radial_velocity, cmap=DIVERGING, vmin=-reach, vmax=reach, alpha=0.85)
        arrow_positions = arrow_grid(axes, 18.0)
        tangential, _ = flow.at(*arrow_positions, np.full(arrow_positions[0].size, radius))
        draw_vectors(axes, *arrow_positions, tangential, scale=reach, longest=_LONGEST, color="0.1")
        draw_arrow_key(axes, reach, "km/s across", _LONGEST)
        known_share = _compute_known_variance_share(flow, radius)
        axes.set_title(f"{radius:.0f} Mpc/h: {known_share:.0%} of the variance known")
    bar = axes.figure.colorbar(image, ax=list(subplots), orientation="horizontal", shrink=0.7, pad=0.02, aspect=30)
    bar.set_label("velocity away from us  [km/s], in the frame of the CMB")
    return subplots


def _compute_known_variance_share(flow, radius, n_directions=48):
    """The share of the modes' variance that the fit took away, over directions."""
    lon, lat = even_grid(30.0)
    lon, lat = lon[:: max(1, lon.size // n_directions)], lat[:: max(1, lat.size // n_directions)]
    tangential, radial = flow.modes.at(lon, lat, np.full(lon.size, radius))
    velocity_components = np.concatenate([tangential[0], tangential[1], radial])
    remaining_variance = np.einsum("ni,ij,nj->n", velocity_components, flow.covariance, velocity_components)
    return max(0.0, 1 - remaining_variance.sum() / np.sum(velocity_components**2))


@apply_style
def plot_forecast(forecast: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Errors of H0 against the redshift limit."""
    n_catalogues = len(forecast.catalogues)
    subplots = panels(ax, n_catalogues, 1, size=(WIDTH, 1.9 * n_catalogues + 0.6), sharex=True)
    colours = ("#7f7f7f", *COLOURS)
    for axes, name, errors in zip(subplots, forecast.catalogues, forecast.hubble, strict=True):
        for assumption, assumption_errors, colour in zip(forecast.known, errors.T, colours, strict=False):
            style = "--" if assumption == "independent" else "-"
            axes.plot(forecast.limits, assumption_errors, marker="o", color=colour, linestyle=style, label=assumption)
        axes.set_yscale("log")
        set_log_ticks(axes.yaxis, *axes.get_ylim())
        axes.set_title(name, loc="left")
        axes.set(xticks=forecast.limits, ylabel="error of $H_0$  [km/s/Mpc]")
    subplots[-1].set_xlabel("galaxies with z below")
    axes.figure.legend(*subplots[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return subplots
