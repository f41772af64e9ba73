"""Figures of moments (matplotlib)."""

from typing import Any

import numpy as np

from vsh.figures.plot import SkyAxes, plot_map
from vsh.sky.pixels import centres
from vsh.tools.types import Axes


def plot_moments(moments: Any, *, ax: Axes | None = None) -> SkyAxes:
    """Plot the weight of the sources on the sky, as smooth as their moments have it."""
    lat, weight = moments.on_sky()
    lon_of, lat_of = centres(32)
    ring = np.abs(lat_of[:, None] - lat).argmin(1)
    column = np.round(lon_of / (2 * np.pi) * weight.shape[1]).astype(int) % weight.shape[1]
    values = weight[ring, column]
    return plot_map(
        values,
        "weight of the sources  [(yr/µas)² a steradian]",
        frame=moments.frame,
        ax=ax,
        vmin=0,
        extend="max",
        vmax=np.percentile(values, 99),
        title=f"{moments.n_sources} sources, to degree {moments.lmax}",
    )
