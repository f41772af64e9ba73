"""Pages that need no network: panels of tables, figures and an interactive sky."""

from vsh.figures.page._page import (
    MAX_SOURCES,
    Panel,
    ShownPage,
    bundle,
    cards,
    facts,
    figure,
    figures,
    heading,
    notes,
    page,
    pictures,
    preformatted_panel,
    provenance,
    section,
    sky,
    table,
    widget,
    words,
    write_page,
)

__all__ = ["Panel", "page", "sky", "widget", "write_page"]
