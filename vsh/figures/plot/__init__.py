"""Figures of the sky and of everything else, in one style (matplotlib)."""

from vsh.figures.plot._arrows import LONGEST, arrow_grid, draw_key, draw_vectors, even_grid
from vsh.figures.plot._field import SURE, plot_field, plot_scalar_field, plot_sources
from vsh.figures.plot._maps import draw_empty, draw_map, plot_map
from vsh.figures.plot._marks import draw_direction, draw_line, draw_matrix, draw_points, draw_sources, symbol
from vsh.figures.plot._sky_axes import PROJECTIONS, SkyAxes, sky_axes
from vsh.figures.plot._style import (
    COLOURS,
    DIVERGING,
    FADED,
    FORMATS,
    KIND_COLOURS,
    KIND_NAMES,
    SEQUENTIAL,
    SIGNIFICANCE,
    STYLE,
    WIDTH,
    close_figures,
    colour_bar,
    figure_of,
    legend_above,
    log_ticks,
    many_figures,
    panels,
    picture_of,
    save_figures,
    styled,
)

__all__ = [
    "SkyAxes",
    "draw_direction",
    "draw_map",
    "draw_points",
    "draw_sources",
    "draw_vectors",
    "plot_field",
    "plot_map",
    "plot_scalar_field",
    "plot_sources",
    "save_figures",
    "sky_axes",
    "styled",
]
