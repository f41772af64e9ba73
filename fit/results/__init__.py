"""What a fit gives: solutions, their quality and spectra, how they are stored, and how they are shown."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.results import output, quality, solution, spectrum, storage

__all__ = ["output", "quality", "solution", "spectrum", "storage"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
