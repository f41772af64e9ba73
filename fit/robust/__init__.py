"""Fits for catalogues whose errors are not to be trusted."""

from fit.robust._clip import ClippedFit, ExcessNoise, clip, compute_truncation_factors, excess_noise
from fit.robust._reweight import ReweightedFit, TailsError, student_t
from vsh.tools.modules import hint_missing_names

__all__ = ["ExcessNoise", "ReweightedFit", "excess_noise", "student_t"]

__getattr__ = hint_missing_names(__name__, __all__)
