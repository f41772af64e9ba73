"""What a sky cannot separate, why, and what leaks into a fit."""

from typing import TYPE_CHECKING

from fit.correlation._forecast import Prediction, predict_covariance
from fit.correlation._leakage import Leakage, leakage, lmax_table
from fit.correlation._matrices import (
    FRAME,
    CorrelationMatrices,
    correlation_matrices,
    field_from_positions,
    influence_map,
    parameters_of,
    select_parameters,
)
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.correlation._plot import plot_influence, symbol

__all__ = [
    "CorrelationMatrices",
    "Leakage",
    "Prediction",
    "correlation_matrices",
    "field_from_positions",
    "influence_map",
    "leakage",
    "lmax_table",
    "predict_covariance",
]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_influence", "symbol"]})
