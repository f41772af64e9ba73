"""The acceleration with every error that is known of: what the first line says."""

from dataclasses import dataclass, replace

import numpy as np

from fit.background import Floor, floor
from fit.output import verdict
from fit.robust import student_t
from fit.solution import Solution
from fit.solving import fit_field, solve
from study.referee._quasars import Quasars, degree_for
from vsh.tools.errors import VshError
from vsh.tools.notebook import InNotebook
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class Headline(InNotebook):
    """A robust fit of all sources, with the floor in its errors where the sources determine one.

    Attributes
    ----------
    solution : Solution
    floor : Floor or None
    verdict : str
        In words.
    """

    solution: Solution
    floor: Floor | None
    verdict: str

    @property
    def acceleration(self) -> Vector:
        """The acceleration, with what sources share. [µas/yr]"""
        return self.solution.acceleration


def headline(quasars: Quasars) -> Headline:
    """What `vsh-fit --recommended` answers: Student's t on all sources, then the floor; plain errors where few."""
    field = quasars.whole
    lmax = degree_for(len(field), quasars.degree)
    try:
        solution = student_t(field, lmax).solution
    except VshError as error:
        solution = fit_field(field, lmax, floor=False)
        solution = replace(solution, notes=(*solution.notes, f"warning: no robust fit ({error})"))
    shared = _floor(solution)
    if shared is not None:
        from fit.background import equations_of

        dof = solution.covariance_dof
        solution = replace(solve(equations_of(solution), floor=shared), covariance_dof=dof)
    said = verdict(solution, shared=shared is not None).removeprefix("verdict: ")
    return Headline(solution, shared, said)


def _floor(solution):
    if solution.modes.lmax < 3:
        return None
    try:
        shared = floor(solution)
    except VshError:
        return None
    return shared if np.isfinite([*shared.odd_interval, *shared.even_interval]).all() else None
