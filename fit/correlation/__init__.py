"""What a sky cannot tell apart, why, and what leaks into a fit."""

from typing import TYPE_CHECKING

import lazy_loader

from fit.correlation._downweight import Thinned, thin
from fit.correlation._forecast import Prediction, plan, predict
from fit.correlation._influence import blamed, gain, influence
from fit.correlation._leakage import Eigenmodes, Leakage, eigenmodes, leakage, lmax_table, recommend_lmax
from fit.correlation._matrices import CorrelationMap, correlation_map, dipole
from fit.correlation._parameters import named, parameters, symbol

if TYPE_CHECKING:
    from fit.correlation._plot import plot_influence

__all__ = [
    "CorrelationMap",
    "Eigenmodes",
    "Leakage",
    "Prediction",
    "Thinned",
    "blamed",
    "correlation_map",
    "dipole",
    "eigenmodes",
    "gain",
    "influence",
    "leakage",
    "lmax_table",
    "named",
    "parameters",
    "plan",
    "plot_influence",
    "predict",
    "recommend_lmax",
    "symbol",
    "thin",
]

# matplotlib is imported when a figure is first asked for.
__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"_plot": ["plot_influence"]})


def __dir__() -> list[str]:
    return __all__
