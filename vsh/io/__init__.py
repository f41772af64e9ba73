"""Files and catalogues: tables of every format, fields in them, sources in parts, transits, archives."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from vsh.io import archive, catalogue, epochs, maps, parts, results, tables

__all__ = ["archive", "catalogue", "epochs", "maps", "parts", "results", "tables"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
