"""What is shown of a solution: text, page, figures, files and notebooks."""

from typing import TYPE_CHECKING

from fit.output._answer import Answer, answer_of
from fit.output._answer import words_of as words_of
from fit.output._files import draw_figures, sources_table, write_correlation, write_figures, write_html, write_tables
from fit.output._latex import latex_of
from fit.output._report import WIDTH, html_of, report, report_check, warnings_of
from fit.output._rows import (
    amplitude,
    cell,
    components,
    direction,
    is_seen,
    power_rows,
    powers_table,
    pulls,
    vector_rows,
    vectors_of,
    vectors_table,
)
from fit.quality import printed_p_value as p_value
from vsh.tools.modules import lazily
from vsh.tools.notes import note_lines

if TYPE_CHECKING:
    from fit.output._figures import plot_correlation, plot_power, plot_residuals, plot_spectrum, plot_terms
    from fit.output._html import html_report

__all__ = [
    "Answer",
    "answer_of",
    "html_report",
    "plot_correlation",
    "plot_power",
    "plot_residuals",
    "plot_spectrum",
    "write_html",
]

# matplotlib is imported when a figure is first asked for.
_FIGURES = ["plot_correlation", "plot_power", "plot_residuals", "plot_spectrum", "plot_terms"]
__getattr__, __dir__ = lazily(__name__, __all__, {"_figures": _FIGURES, "_html": ["html_report"]})
