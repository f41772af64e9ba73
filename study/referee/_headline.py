"""The acceleration with every error that is known of: what the first line says."""

from dataclasses import dataclass, replace

import numpy as np

from fit.background import Floor, equations_of, floor, shared
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
    p_acceleration, p_spin : float
        Probability of as large ones by chance, the mean over what sources may share.
    """

    solution: Solution
    floor: Floor | None
    verdict: str
    p_acceleration: float
    p_spin: float

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
    common = _floor(solution)
    if common is None:
        said = verdict(solution, shared=False).removeprefix("verdict: ")
        return Headline(solution, None, said, solution.acceleration.p_value, solution.spin.p_value)
    # The errors of a robust fit are known already: they are not scaled again.
    beside = shared([solution], labels=["all sources"], noise_scale=False)
    p_acceleration, p_spin = (beside.p_value(kind) for kind in ("S", "T"))
    dof = solution.covariance_dof
    solution = replace(solve(equations_of(solution), floor=common), covariance_dof=dof)
    said = verdict(solution, shared=True, p_value=p_acceleration, p_spin=p_spin).removeprefix("verdict: ")
    return Headline(solution, common, said, p_acceleration, p_spin)


def _floor(solution):
    if solution.modes.lmax < 3:
        return None
    try:
        common = floor(solution)
    except VshError:
        return None
    return common if np.isfinite([*common.odd_interval, *common.even_interval]).all() else None
