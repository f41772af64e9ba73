"""How a result varies when its sources do: bootstrap and jackknife."""

from fit.resample._blocks import BlockLength, block_bootstrap, compare_blocks, jackknife
from fit.resample._bootstrap import Resampled, bootstrap, parametric_bootstrap

__all__ = ["Resampled", "block_bootstrap", "bootstrap", "compare_blocks", "jackknife", "parametric_bootstrap"]
