"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import ClippedFit, ExcessNoise, clip, excess_noise, truncation_factors
from fit.robust._reweight import ReweightedFit, TailsError, student_t

__all__ = ["ExcessNoise", "ReweightedFit", "excess_noise", "student_t"]
