"""Any degrees in bins of redshift: do all sources see the same sky?"""

from fit.redshift._bins import binned, equal_information
from fit.redshift._contrasts import ChiSquare
from fit.redshift._permutation import chances_by_shuffling
from fit.redshift._solution import BinnedSolution, Trend

__all__ = [
    "BinnedSolution",
    "ChiSquare",
    "Trend",
    "binned",
    "chances_by_shuffling",
    "equal_information",
]
