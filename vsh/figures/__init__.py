"""Pictures: figures of the sky and pages that need no network."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from vsh.figures import page, plot

__all__ = ["page", "plot"]

__getattr__, _, _ = lazy_loader.attach(__name__, submodules=__all__)


def __dir__() -> list[str]:
    return __all__
