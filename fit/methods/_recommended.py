"""The fit to quote: Student's t, to a degree that the sources bear, with the systematic floor in the errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.background import Floor, equations_of, floor
from fit.normal import NormalEquations, Template, normal_equations
from fit.robust import ExcessNoise, Reweighted, student_t
from fit.solution import AboutSolution, Solution
from fit.solving import fit_field, solve, with_coverage
from vsh.field import Field
from vsh.io.catalogue import as_field
from vsh.io.parts import Parts, as_parts
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.errors import ConvergenceError, DegeneracyError, VshError
from vsh.tools.types import Rng

#: A fit to degree L needs so many sources for each of its 2 L (L + 2) unknowns, two numbers each.
_PER_MODE = 4
#: The degree unless another is named: the spectrum of the systematic errors is seen best from 5 on.
_DEGREE = 5
#: From this degree on the floor is estimated.
_LEAST = 3


class Weighted(AboutSolution):
    """A fit whose weights sum other equations, too: of classes, of other degrees, with templates."""

    weights: Reweighted | ExcessNoise | None

    def equations(
        self, field: Field | Parts, modes: Modes | int, *, templates: Sequence[Template] = ()
    ) -> NormalEquations:
        """Sum normal equations of some of the sources, a class say, by the weights of this fit.

        Parameters
        ----------
        field, modes, templates
            As for `fit.robust.Reweighted.equations`.
        """
        if self.weights is None:
            return normal_equations(field, modes, templates=templates)
        return self.weights.equations(field, modes, templates=templates)


@dataclass(frozen=True, eq=False)
class Recommended(Weighted):
    """The recommended fit.

    Attributes
    ----------
    solution : Solution
        With the floor in its errors, where there is one.
    plain : Solution
        The robust fit without it.
    weights : Reweighted or None
        The robust fit; None where it did not settle, and least squares stands in its place.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> result = recommended(Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0)))
    >>> print(result.verdict.splitlines()[0].partition(",")[0])
    acceleration   not detected: < 5.98 µas/yr (95 %)
    """

    solution: Solution
    plain: Solution
    weights: Reweighted | None

    @property
    def floor(self) -> Floor | None:
        """The systematic floor in the errors; None where the sources do not determine one."""
        return self.solution.floor


def degree_for(n_sources: int, most: int, least: int = 1) -> int:
    """Find the highest degree up to `most` that so many sources bear.

    Parameters
    ----------
    n_sources : int
        How many there are.
    most, least : int
        The highest degree wanted, and the lowest that is of use.

    Raises
    ------
    DegeneracyError
        If they do not bear the lowest.
    """
    lmax = next((l for l in range(most, 0, -1) if n_sources >= _PER_MODE * l * (l + 2)), 0)
    if lmax < least:
        raise DegeneracyError(f"{n_sources} sources do not bear degree {least}")
    return lmax


@arguments.accepts(field=as_field, rng=arguments.seed)
def recommended(field: Any, lmax: int | None = None, *, rng: Rng = 1) -> Recommended:
    """Fit a catalogue as recommended: robustly, and with systematic errors in the errors of spin and acceleration.

    Parameters
    ----------
    field : Field, Parts, path or table
        The sources; what is no Field is read by `vsh.read_field`.
    lmax : int, optional
        The highest degree; 5 unless given. It is lowered, with a note, where the sources are too few, or see too little
        of the sky to tell the modes apart: below degree 3 there is no floor.
    rng : Generator or int
        As for the other estimators of `fit.METHODS`; nothing is drawn.

    Raises
    ------
    DegeneracyError
        If the sources do not determine spin and acceleration.

    Notes
    -----
    On 200 clean skies it is as precise as least squares with a floor; coverage on simulated skies, those with
    wrong errors, outliers and systematic errors among them, is in docs/validation.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> result = recommended(Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0)))
    >>> result.solution.modes.lmax, result.floor is not None
    (5, True)
    """
    n_sources = as_parts(field).sum(len)
    asked = _DEGREE if lmax is None else arguments.whole("lmax", lmax)
    degree, why = degree_for(max(n_sources, 12), asked), f"{n_sources} sources do not bear more"
    while True:
        try:
            weights, solution = _robust(field, degree)
            break
        except DegeneracyError:
            if degree == 1:
                raise
            degree, why = degree - 1, f"the {n_sources} sources see too little of the sky for more"
    if degree < asked:
        note = f"fitted to degree {degree} instead of {asked}: {why}"
        solution = replace(solution, notes=(*solution.notes, note))
    plain = with_coverage(solution, field)
    systematic = _floor(plain)
    if systematic is None:
        return Recommended(replace(plain, is_recommended=True), plain, weights)
    solution = solve(equations_of(plain), floor=systematic)
    formal = plain.covariance if plain.formal_covariance is None else plain.formal_covariance
    return Recommended(replace(solution, formal_covariance=formal, is_recommended=True), plain, weights)


def _robust(field, degree):
    """Student's t, or least squares where its weights do not settle."""
    try:
        weights = student_t(field, degree)
        return weights, weights.solution
    except ConvergenceError as error:
        solution = fit_field(field, degree)
        note = f"warning: least squares in place of Student's t ({error})"
        return None, replace(solution, notes=(*solution.notes, note))


def _floor(solution):
    """The systematic floor, or None where the solution determines none."""
    if solution.modes.lmax < _LEAST:
        return None
    try:
        systematic = floor(solution)
    except VshError:
        return None
    return systematic if np.isfinite([*systematic.odd_interval, *systematic.even_interval]).all() else None
