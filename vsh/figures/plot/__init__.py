"""Figures of the sky and of everything else, in one style (matplotlib)."""

from vsh.figures.plot._field import (
    CHANCE,
    LONGEST,
    SURE,
    arrow_grid,
    compute_smallest_chance,
    draw_arrow_key,
    draw_vectors,
    even_grid,
    plot_field,
    plot_scalar_field,
    plot_sources,
)
from vsh.figures.plot._sky_axes import (
    NAMED,
    PROJECTIONS,
    SkyAxes,
    draw_direction,
    draw_empty,
    draw_line,
    draw_map,
    draw_matrix,
    draw_points,
    draw_sources,
    plot_map,
    sky_axes,
)
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
    allow_many_figures,
    apply_style,
    close_figures,
    colour_bar,
    figure_of,
    legend_above,
    make_png,
    panels,
    save_figures,
    set_log_ticks,
)
from vsh.tools.modules import hint_missing_names

__all__ = [
    "SkyAxes",
    "apply_style",
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
]

__getattr__ = hint_missing_names(__name__, __all__)
