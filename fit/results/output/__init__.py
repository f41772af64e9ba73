"""What is shown of a solution: text, page, figures, files and notebooks."""

from typing import TYPE_CHECKING

from fit.results.output._files import draw_figures, latex_of, sources_table, write_correlation, write_tables
from fit.results.output._text import (
    answer_of,
    cell,
    cross_check_sections,
    format_amplitude,
    format_components,
    format_direction,
    is_seen,
    power_rows,
    powers_table,
    pulls,
    sections_of,
    vector_rows,
    vectors_of,
    vectors_table,
    warnings_of,
)
from fit.results.output._text import square_of as square_of
from fit.results.output._text import words_of as words_of
from vsh.tools.digits import format_p_value as p_value
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.results.output._figures import plot_correlation, plot_residuals, plot_sky, plot_spectrum, plot_terms
    from fit.results.output._html import write_html

__all__ = ["answer_of", "plot_correlation", "plot_residuals", "plot_spectrum", "write_html"]

# matplotlib is imported when a figure is first asked for.
_FIGURES = ["plot_correlation", "plot_residuals", "plot_sky", "plot_spectrum", "plot_terms"]
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_figures": _FIGURES, "_html": ["write_html"]})
