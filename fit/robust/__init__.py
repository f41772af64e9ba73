"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import Clipped, clip
from fit.robust._excess_noise import ExcessNoise, excess_noise
from fit.robust._reweight import Reweighted, permissive, student_t

__all__ = ["ExcessNoise", "Reweighted", "excess_noise", "permissive", "student_t"]
