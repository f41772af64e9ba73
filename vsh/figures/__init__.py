"""Pictures: figures of the sky and pages that need no network."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from vsh.figures import page, plot

__all__ = ["page", "plot"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
