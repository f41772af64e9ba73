"""What a sky cannot separate, why, and what leaks into a fit."""

from typing import TYPE_CHECKING

from fit.correlation._forecast import DownweightResult, Prediction, compare_cuts, downweight, predict_covariance
from fit.correlation._leakage import Leakage, leakage, lmax_table, recommend_lmax
from fit.correlation._matrices import (
    FRAME,
    CorrelationMatrices,
    Eigenmodes,
    correlation_matrices,
    dipole,
    eigenmodes,
    field_from_positions,
    gain_of_sources,
    influence_map,
    most_influential,
    named,
    parameters_of,
)
from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from fit.correlation._plot import plot_influence, symbol

__all__ = [
    "CorrelationMatrices",
    "DownweightResult",
    "Eigenmodes",
    "Leakage",
    "Prediction",
    "compare_cuts",
    "correlation_matrices",
    "downweight",
    "eigenmodes",
    "field_from_positions",
    "influence_map",
    "leakage",
    "predict_covariance",
    "recommend_lmax",
]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazily(__name__, __all__, {"_plot": ["plot_influence", "symbol"]})
