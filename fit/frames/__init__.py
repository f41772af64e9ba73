"""Catalogues against each other: a pair, a chain of several, and the link of frames at all magnitudes."""

from typing import TYPE_CHECKING

from fit.frames.results import FrameResult
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.frames import chain, compare, link

__all__ = ["FrameResult", "chain", "compare", "link"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
