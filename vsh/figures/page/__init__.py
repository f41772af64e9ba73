"""Pages that need no network: panels of tables, figures and an interactive sky."""

from vsh.figures.page._page import (
    MAX_SOURCES,
    Panel,
    ShownSolution,
    facts_panel,
    figure_panel,
    figure_row,
    join_panels,
    notes_panel,
    page,
    panel_row,
    paragraph,
    preformatted_panel,
    provenance_panel,
    section_panel,
    sky,
    table,
    widget,
    write_page,
)

__all__ = ["Panel", "page", "sky", "widget", "write_page"]
