"""Files and catalogues: tables of every format, fields in them, sources in parts, transits, archives."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from vsh.io import archive, catalogue, epochs, maps, parts, tables

__all__ = ["archive", "catalogue", "epochs", "maps", "parts", "tables"]

__getattr__, _, _ = lazy_loader.attach(__name__, submodules=__all__)


def __dir__() -> list[str]:
    return __all__
