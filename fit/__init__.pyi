"""What `fit` holds: for type checkers, and for whoever asks (lazy_loader reads the imports here)."""

from . import (
    background,
    correlation,
    direct,
    frames,
    in_time,
    methods,
    motions,
    pairs,
    posterior,
    redshift,
    resample,
    results,
    robust,
    secular_parallax,
    waves,
)
from .direct import CrossCheck, FrameSolution, cross_check, solve_frame
from .frames import chain, compare, link
from .methods import METHODS, Estimate, Recommended, estimate, recommended
from .motions import galaxy, shear, stars
from .motions.stars import Kinematics, kinematics
from .normal import Moments, NormalEquations, fit_field, gaussian_prior, normal_equations, solve
from .results import output, quality, spectrum, storage
from .results.solution import Solution
from .robust import ClippedFit, clip

__all__ = [
    "METHODS",
    "ClippedFit",
    "CrossCheck",
    "Estimate",
    "FrameSolution",
    "Kinematics",
    "Moments",
    "NormalEquations",
    "Recommended",
    "Solution",
    "background",
    "chain",
    "clip",
    "compare",
    "correlation",
    "cross_check",
    "direct",
    "estimate",
    "fit_field",
    "frames",
    "galaxy",
    "gaussian_prior",
    "in_time",
    "kinematics",
    "link",
    "methods",
    "motions",
    "normal_equations",
    "output",
    "pairs",
    "posterior",
    "quality",
    "recommended",
    "redshift",
    "resample",
    "results",
    "robust",
    "secular_parallax",
    "shear",
    "solve",
    "solve_frame",
    "spectrum",
    "stars",
    "storage",
    "waves",
]
