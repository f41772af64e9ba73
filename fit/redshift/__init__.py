"""Any degrees in bins of redshift: are the coefficients the same at all redshifts?"""

from fit.redshift._bins import binned, equal_information_edges, permutation_test
from fit.redshift._solution import FLOW_MATTERS, BinnedSolution, ChiSquare, Trend

__all__ = ["BinnedSolution", "Trend", "binned", "permutation_test"]
