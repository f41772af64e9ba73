"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import ClippedFit, ExcessNoise, clip, compute_truncation_factors, excess_noise
from fit.robust._reweight import ReweightedFit, TailsError, student_t

__all__ = ["ExcessNoise", "ReweightedFit", "excess_noise", "student_t"]
