"""From a field to what it says: normal equations, their solution, its report."""

from importlib import import_module

from fit import frame, robust, spectrum
from fit.check import CrossCheck, cross_check
from fit.frame import FrameSolution, solve_frame
from fit.matrix_free import MatrixFreeSolution, solve_matrix_free
from fit.normal import NormalEquations, gaussian_prior, normal_equations
from fit.report import report
from fit.robust import Clipped, clip
from fit.solution import Solution
from fit.solve import fit_field, solve

__all__ = [
    "Clipped",
    "CrossCheck",
    "FrameSolution",
    "MatrixFreeSolution",
    "NormalEquations",
    "Solution",
    "clip",
    "cross_check",
    "fit_field",
    "frame",
    "gaussian_prior",
    "normal_equations",
    "report",
    "robust",
    "solve",
    "solve_frame",
    "solve_matrix_free",
    "spectrum",
]

# Rooms with heavy friends open on the first visit.
_LAZY = {"correlation", "drift", "export", "plot", "posterior", "redshift", "resample"}


def __getattr__(name):
    if name in _LAZY:
        return import_module(f"fit.{name}")
    raise AttributeError(f"module 'fit' has no attribute {name!r}")


def __dir__():
    return sorted({*globals(), *_LAZY})
