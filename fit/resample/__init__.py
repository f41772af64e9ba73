"""How a result varies when its sources do: bootstrap and jackknife."""

from fit.resample._block_lengths import BlockLength, compare_blocks
from fit.resample._resample import Resampled, block_bootstrap, bootstrap, jackknife, parametric_bootstrap

__all__ = [
    "BlockLength",
    "Resampled",
    "block_bootstrap",
    "bootstrap",
    "compare_blocks",
    "jackknife",
    "parametric_bootstrap",
]
