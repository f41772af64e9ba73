"""Figures of the sky and of everything else, in one style (matplotlib)."""

from vsh.plot._arrows import LONGEST, draw_vectors
from vsh.plot._field import SURE, plot_field
from vsh.plot._files import FORMATS, close_figures, picture_of, save_figures
from vsh.plot._grid import arrow_grid, even_grid
from vsh.plot._maps import draw_empty, draw_map, plot_map
from vsh.plot._marks import draw_direction, draw_line, draw_points, draw_sources
from vsh.plot._matrix import draw_matrix, symbol
from vsh.plot._scalar import plot_scalar_field
from vsh.plot._sky_axes import PROJECTIONS, SkyAxes, sky_axes
from vsh.plot._style import (
    COLOURS,
    DIVERGING,
    FADED,
    KIND_COLOURS,
    KIND_NAMES,
    SEQUENTIAL,
    SIGNIFICANCE,
    STYLE,
    WIDTH,
    colour_bar,
    figure_of,
    legend_above,
    log_ticks,
    panels,
    styled,
)

__all__ = [
    "FORMATS",
    "PROJECTIONS",
    "SkyAxes",
    "draw_direction",
    "draw_map",
    "draw_points",
    "draw_sources",
    "draw_vectors",
    "plot_field",
    "plot_map",
    "plot_scalar_field",
    "save_figures",
    "sky_axes",
    "styled",
]
