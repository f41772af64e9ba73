"""From a field to what it says: normal equations, their solution, its report."""

from typing import TYPE_CHECKING

import lazy_loader

from fit import frame, robust, spectrum
from fit.check import CrossCheck, cross_check
from fit.frame import FrameSolution, solve_frame
from fit.matrix_free import MatrixFreeSolution, solve_matrix_free
from fit.normal import Moments, NormalEquations, gaussian_prior, normal_equations
from fit.output import report
from fit.robust import Clipped, clip
from fit.solution import Solution
from fit.solve import fit_field, solve

if TYPE_CHECKING:
    from fit import (
        background,
        correlation,
        galaxy,
        output,
        pairs,
        posterior,
        redshift,
        resample,
        secular_parallax,
        shear,
        waves,
    )

__all__ = [
    "Clipped",
    "CrossCheck",
    "FrameSolution",
    "MatrixFreeSolution",
    "Moments",
    "NormalEquations",
    "Solution",
    "background",
    "clip",
    "compare",
    "correlation",
    "cross_check",
    "fit_field",
    "frame",
    "galaxy",
    "gaussian_prior",
    "normal_equations",
    "output",
    "pairs",
    "posterior",
    "redshift",
    "report",
    "resample",
    "robust",
    "secular_parallax",
    "shear",
    "solve",
    "solve_frame",
    "solve_matrix_free",
    "spectrum",
    "waves",
]

# Imported when first asked for: emcee, healpy and matplotlib come with them.
_LATER = [
    "background",
    "compare",
    "correlation",
    "galaxy",
    "output",
    "pairs",
    "posterior",
    "redshift",
    "resample",
    "secular_parallax",
    "shear",
    "waves",
]
__getattr__, _, _ = lazy_loader.attach(__name__, _LATER)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
