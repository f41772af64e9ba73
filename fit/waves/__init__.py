"""One gravitational wave from one direction: its best strain, how likely noise alone is, and limits."""

from typing import TYPE_CHECKING

from fit.waves._search import WaveSearch, WaveSpectrum, search, search_in_time
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.waves._plot import plot_search, plot_spectrum

__all__ = ["WaveSearch", "WaveSpectrum", "search", "search_in_time"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_search", "plot_spectrum"]})
