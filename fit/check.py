"""Two solvers that share no formula, on the same sources."""

from dataclasses import dataclass

import numpy as np

from fit.frame import FrameSolution, solve_frame
from fit.solution import Solution
from fit.solve import fit_field


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """Spin and acceleration by harmonics of degree 1 and by the direct frame solver.

    Attributes
    ----------
    harmonics : Solution
    direct : FrameSolution
    largest : float
        Their largest difference in any component, in units of its standard error.
    """

    harmonics: Solution
    direct: FrameSolution
    largest: float


def cross_check(field):
    """Fit degree 1 to a field by both solvers and compare.

    Raises
    ------
    DegeneracyError
        If the sources cannot tell spin and acceleration apart.
    """
    harmonics, direct = fit_field(field, 1), solve_frame(field)
    pairs = [(harmonics.spin, direct.spin), (harmonics.acceleration, direct.acceleration)]
    largest = max(float(np.max(np.abs(one.value - two.value) / two.sigma)) for one, two in pairs)
    return CrossCheck(harmonics, direct, largest)
