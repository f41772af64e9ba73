"""How a result varies when its sources do: bootstrap and jackknife."""

from fit.resample._block_lengths import BlockLength, compare_blocks
from fit.resample._blocks import block_bootstrap, jackknife
from fit.resample._bootstrap import bootstrap, parametric_bootstrap
from fit.resample._resampled import Resampled

__all__ = [
    "BlockLength",
    "Resampled",
    "block_bootstrap",
    "bootstrap",
    "compare_blocks",
    "jackknife",
    "parametric_bootstrap",
]
