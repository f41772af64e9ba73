"""Any degrees in bins of redshift: are the coefficients the same at all redshifts?"""

from fit.redshift._bins import binned, equal_information
from fit.redshift._contrasts import ChiSquare, Trend
from fit.redshift._permutation import permutation_test
from fit.redshift._shared import FLOW_MATTERS
from fit.redshift._solution import BinnedSolution

__all__ = [
    "BinnedSolution",
    "ChiSquare",
    "Trend",
    "binned",
    "equal_information",
    "permutation_test",
]
