"""Forecasts, the referee, and skies for inference without a likelihood.

The one place that knows both `sim` and `fit`.
"""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from study.skies import SkyStatistics, simulate_skies

__all__ = ["SkyStatistics", "simulate_skies"]

# Imported when first asked for: all of `sim` and `fit` come with them.
__getattr__, __dir__ = lazily(__name__, __all__, {"skies": ["SkyStatistics", "simulate_skies"]})
