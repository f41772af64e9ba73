"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import Clipped, ExcessNoise, clip, excess_noise
from fit.robust._reweight import ERRORS_TOO_SMALL, Reweighted, permissive, student_t

__all__ = ["ExcessNoise", "Reweighted", "excess_noise", "permissive", "student_t"]
