"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import Clipped, clip
from fit.robust._excess_noise import ExtraNoise, extra_noise
from fit.robust._reweight import Reweighted, permissive, student_t

__all__ = [
    "Clipped",
    "ExtraNoise",
    "Reweighted",
    "clip",
    "extra_noise",
    "permissive",
    "student_t",
]
