"""Pages that need no network: panels of tables, figures and an interactive sky."""

from vsh.figures.page._page import (
    MAX_SOURCES,
    Panel,
    ShownSolution,
    facts,
    figure,
    figure_row,
    heading,
    notes,
    page,
    panel_row,
    paragraph,
    preformatted_panel,
    provenance,
    section,
    sky,
    table,
    widget,
    write_page,
)

__all__ = ["Panel", "page", "sky", "widget", "write_page"]
