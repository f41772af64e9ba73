"""Two solvers that share no formula, on the same sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.frame import FrameSolution, solve_frame
from fit.normal import normal_equations
from fit.solution import Solution
from fit.solving import solve
from fit.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.models.covariance import Covariance
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.logs import told
from vsh.tools.types import FloatArray, Table


@dataclass(frozen=True, eq=False)
class CrossCheck(Result):
    """Spin and acceleration by harmonics of degree 1 and by the direct frame solver.

    Attributes
    ----------
    harmonics : Solution
    frame : FrameSolution
    largest : float
        Their largest difference in any component, in units of its standard error.
    """

    harmonics: Solution
    frame: FrameSolution
    largest: float

    def report(self) -> str:
        """Whether the two solvers agree, as text."""
        from fit.output import report_check

        return report_check(self) + "\n"

    def to_table(self) -> Table:
        """Both solutions as an astropy Table: a row for each component of spin and acceleration."""
        columns: dict[str, Any] = {"parameter": list(self.frame.names)}
        for name, found in (("harmonics", self.harmonics), ("frame_solver", self.frame)):
            spin: Any = found.spin
            columns[name] = np.concatenate([spin.value, found.acceleration.value])
            columns[f"{name}_error"] = np.concatenate([spin.sigma, found.acceleration.sigma])
        return tables.table_of(columns, {"frame": self.frame.frame})

    def plot(self, *, ax: Any = None) -> Any:
        """The correlations of the frame solver's parameters on matplotlib axes."""
        return self.frame.plot(ax=ax)


@told("cross-check")
@arguments.accepts(field=arguments.a(Field, Parts))
def cross_check(field: Field | Parts, *, covariance: Covariance | FloatArray | None = None) -> CrossCheck:
    """Fit degree 1 to a field by both solvers and compare.

    Parameters
    ----------
    field : Field or Parts
        The sources. Parts are gone through twice.
    covariance : Covariance or (2n, 2n) array, optional
        As for `normal_equations`.

    Raises
    ------
    DegeneracyError
        If the sources cannot tell spin and acceleration apart.
    """
    # Not the short cut for degree 1, which writes the same p and q: the harmonics themselves.
    harmonics = solve(normal_equations(field, Modes(1), method="design-matrix", covariance=covariance))
    direct = solve_frame(field, covariance=covariance)
    pairs: list[Any] = [(harmonics.spin, direct.spin), (harmonics.acceleration, direct.acceleration)]
    largest = max(float(np.max(np.abs(one.value - two.value) / two.sigma)) for one, two in pairs)
    return CrossCheck(harmonics, direct, largest)
