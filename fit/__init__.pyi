"""What `fit` holds: for type checkers, and for whoever asks (lazy_loader reads the imports here)."""

from . import (
    background,
    chain,
    compare,
    correlation,
    frame,
    galaxy,
    in_time,
    link,
    methods,
    output,
    pairs,
    posterior,
    redshift,
    resample,
    robust,
    secular_parallax,
    shear,
    spectrum,
    stars,
    storage,
    waves,
)
from .frame import CrossCheck, FrameSolution, cross_check, solve_frame
from .matrix_free import MatrixFreeSolution, solve_matrix_free
from .methods import METHODS, Estimate, Recommended, estimate, recommended
from .normal import Moments, NormalEquations, gaussian_prior, normal_equations
from .robust import Clipped, clip
from .solution import Solution
from .solving import fit_field, solve
from .stars import Kinematics, kinematics

__all__ = [
    "METHODS",
    "Clipped",
    "CrossCheck",
    "Estimate",
    "FrameSolution",
    "Kinematics",
    "MatrixFreeSolution",
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
    "estimate",
    "fit_field",
    "frame",
    "galaxy",
    "gaussian_prior",
    "in_time",
    "kinematics",
    "link",
    "methods",
    "normal_equations",
    "output",
    "pairs",
    "posterior",
    "recommended",
    "redshift",
    "resample",
    "robust",
    "secular_parallax",
    "shear",
    "solve",
    "solve_frame",
    "solve_matrix_free",
    "spectrum",
    "stars",
    "storage",
    "waves",
]
