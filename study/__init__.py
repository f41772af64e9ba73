"""Simulation studies: many skies with a known truth, fitted, and what came of it.

The one place that knows both `sim` and `fit`.
"""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from study.config import Study, load
    from study.run import run
    from study.skies import SkyStatistics, simulate_skies

__all__ = ["SkyStatistics", "Study", "load", "run", "simulate_skies"]

# Imported when first asked for: all of `sim` and `fit` come with them.
__getattr__, __dir__ = lazily(
    __name__, __all__, {"config": ["Study", "load"], "run": ["run"], "skies": ["SkyStatistics", "simulate_skies"]}
)
