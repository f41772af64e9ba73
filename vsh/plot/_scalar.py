"""A map of a scalar field."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.plot._maps import draw_empty, plot_map
from vsh.plot._marks import draw_sources
from vsh.plot._sky_axes import SkyAxes
from vsh.plot._style import DIVERGING, styled
from vsh.scalars import ScalarCoefficients, ScalarField
from vsh.sky.pixels import centres


@styled
def plot_scalar_field(
    field: ScalarField, coefficients: ScalarCoefficients, *, title: str | None = None, ax: Any = None
) -> SkyAxes:
    """A map of a scalar field as fitted, and its sources, each where it is.

    Parameters
    ----------
    field : ScalarField
        The sources; at most 20 000 are shown.
    coefficients : ScalarCoefficients
        The field drawn.
    title : str, optional
        Above the map.
    ax : matplotlib Axes, optional
        Whose place the map takes; a new figure unless given.
    """
    values = coefficients.at(*centres(32))
    middle = float(np.median(values))
    reach = float(np.abs(values - middle).max()) or 1.0
    label = f"the field as fitted{f'  [{field.unit}]' if field.unit else ''}"
    axes = plot_map(values, label, frame=field.frame, cmap=DIVERGING, title=title, ax=ax, vmin=middle - reach, vmax=middle + reach)  # fmt: skip
    draw_sources(axes, field.lon, field.lat, color="0.15", alpha=0.5)
    draw_empty(axes, field.lon, field.lat)
    return axes
