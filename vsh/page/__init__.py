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
    "Panel",
    "figure",
    "page",
    "sky",
    "table",
    "write_page",
]
