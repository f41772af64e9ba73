"""Figures of moments (matplotlib)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.sky.pixels import centres
from vsh.sky.plot import draw_map, sky_axes
from vsh.types import Figure


def plot_moments(moments: Any) -> Figure:
    """Where on the sky the weight of the sources is, as smooth as their moments have it.

    Parameters
    ----------
    moments : Moments
        What to draw.

    Returns
    -------
    matplotlib figure
    """
    lat, weight = moments.on_sky()
    lon_of, lat_of = centres(32)
    ring = np.abs(lat_of[:, None] - lat).argmin(1)
    column = np.round(lon_of / (2 * np.pi) * weight.shape[1]).astype(int) % weight.shape[1]
    axes = sky_axes(moments.frame)
    image = draw_map(axes, weight[ring, column], vmin=0, vmax=np.percentile(weight[ring, column], 99))
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label("weight of the sources  [(yr/µas)² a steradian]", fontsize=12)
    axes.set_title(f"{moments.n_sources} sources, to degree {moments.lmax}", pad=16)
    return axes.figure
