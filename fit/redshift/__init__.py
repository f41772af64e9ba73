"""Any degrees in bins of redshift: are the coefficients the same at all redshifts?"""

from fit.redshift._bins import binned, equal_information, permutation_test
from fit.redshift._contrasts import FLOW_MATTERS, ChiSquare, Trend
from fit.redshift._solution import BinnedSolution

__all__ = ["BinnedSolution", "Trend", "binned", "permutation_test"]
