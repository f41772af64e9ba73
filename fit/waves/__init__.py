"""One gravitational wave from one direction: its best strain, how likely noise alone is, and how strong it can be at most."""

from typing import TYPE_CHECKING

import lazy_loader

from fit.waves._search import WaveSearch, search, search_in_time

if TYPE_CHECKING:
    from fit.waves._map import plot_search

__all__ = ["WaveSearch", "search", "search_in_time"]

# matplotlib is imported when a figure is first asked for.
__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"_map": ["plot_search"]})


def __dir__() -> list[str]:
    return __all__
