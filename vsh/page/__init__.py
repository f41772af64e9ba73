"""Pages that need no network: panels of tables, figures and an interactive sky."""

from vsh.page._page import STATIC, bundle, is_page, page, write_page
from vsh.page._panels import (
    Panel,
    cards,
    figure,
    figures,
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
    "STATIC",
    "Panel",
    "Shown",
    "bundle",
    "cards",
    "figure",
    "figures",
    "heading",
    "is_page",
    "notes",
    "page",
    "pictures",
    "preformatted",
    "provenance",
    "sheet",
    "sky",
    "table",
    "words",
    "write_page",
]
