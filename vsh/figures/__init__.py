"""Pictures: figures of the sky and pages that need no network."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from vsh.figures import page, plot

__all__ = ["page", "plot"]

__getattr__, __dir__ = lazily(__name__, __all__, {})
