"""A map of a scalar field (matplotlib)."""

from __future__ import annotations

import numpy as np

from vsh.scalars import ScalarCoefficients, ScalarField
from vsh.sky.pixels import centres
from vsh.sky.plot import draw_map, draw_sources, sky_axes
from vsh.types import Figure

__all__ = [
    "plot_scalar_field",
]


def plot_scalar_field(field: ScalarField, coefficients: ScalarCoefficients, *, title: str | None = None) -> Figure:
    """A map of a scalar field as fitted, and its sources, each where it is.

    Parameters
    ----------
    field : ScalarField
        The sources; at most 20 000 are shown.
    coefficients : ScalarCoefficients
        The field drawn.
    title : str, optional
        Above the map.

    Returns
    -------
    matplotlib figure
    """
    axes = sky_axes(field.frame)
    values = coefficients.at(*centres(32))
    reach = float(np.abs(values - np.median(values)).max()) or 1.0
    image = draw_map(axes, values, cmap="RdBu_r", vmin=np.median(values) - reach, vmax=np.median(values) + reach)
    draw_sources(axes, field.lon, field.lat, color="0.2", alpha=0.4)
    bar = axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06)
    bar.set_label(f"the field as fitted{f'  [{field.unit}]' if field.unit else ''}", fontsize=12)
    if title:
        axes.set_title(title, pad=16)
    return axes.figure
