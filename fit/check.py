"""Two solvers that share no formula, on the same sources."""

from dataclasses import dataclass

import numpy as np

from fit.frame import FrameSolution, solve_frame
from fit.normal import normal_equations
from fit.solution import Solution
from fit.solve import solve
from vsh.checks import arguments
from vsh.checks.frozen import Frozen
from vsh.field import Field
from vsh.modes import Modes


@dataclass(frozen=True, eq=False)
class CrossCheck(Frozen):
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


@arguments.accepts(field=arguments.a(Field))
def cross_check(field):
    """Fit degree 1 to a field by both solvers and compare.

    Raises
    ------
    DegeneracyError
        If the sources cannot tell spin and acceleration apart.
    """
    # Not the short cut for degree 1, which writes the same p and q: the harmonics themselves.
    harmonics = solve(normal_equations(field, Modes(1), method="direct"))
    direct = solve_frame(field)
    pairs = [(harmonics.spin, direct.spin), (harmonics.acceleration, direct.acceleration)]
    largest = max(float(np.max(np.abs(one.value - two.value) / two.sigma)) for one, two in pairs)
    return CrossCheck(harmonics, direct, largest)
