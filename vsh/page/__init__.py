"""Pages that need no network: panels of tables, figures and an interactive sky."""

from vsh.page._page import bundle, page
from vsh.page._panels import (
    Panel,
    cards,
    figure,
    heading,
    notes,
    pictures,
    preformatted,
    provenance,
    sheet,
    table,
    words,
)
from vsh.page._sky import MAX_SOURCES, Shown, sky

__all__ = [
    "MAX_SOURCES",
    "Panel",
    "Shown",
    "bundle",
    "cards",
    "figure",
    "heading",
    "notes",
    "page",
    "pictures",
    "preformatted",
    "provenance",
    "sheet",
    "sky",
    "table",
    "words",
]
