"""Normal equations: all that a least-squares fit needs to remember of the data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self, cast

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from vsh import Modes
from vsh.modes import ScalarModes, as_modes
from vsh.tools.arguments import float_array
from vsh.tools.errors import FrameError, ModesError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import merge_notes
from vsh.tools.types import ArrayLike, FloatArray


class TemplateField(NamedTuple):
    """A field that a template may cause, of 1 µas/yr (motions) or one unit rms over the sky, cut to a degree."""

    name: str
    values: FloatArray


class Additive:
    """Sums over data: those of parts add, and what went in before can be taken away."""

    notes: tuple[str, ...]

    def __add__(self, other: Self) -> Self:
        return self._add_with_sign(other, +1)

    def __sub__(self, other: Self) -> Self:
        """Take data away that went in before: a block of the sky, say."""
        return self._add_with_sign(other, -1)

    def __radd__(self, other: Any) -> Self:
        return self if other == 0 else NotImplemented  # the start of sum()

    def add_note(self, *notes: str) -> Self:
        """Add `notes` that the reader of a result should know."""
        return replace(cast(Any, self), notes=merge_notes((*self.notes, *notes)))

    def _add_with_sign(self, other, sign):
        raise NotImplementedError

    def _combine_sums(self, other, sign, names):
        """Copy with the sums of another added or taken away, and the notes of both."""
        sums = {name: getattr(self, name) + sign * getattr(other, name) for name in names}
        return replace(cast(Any, self), **sums, notes=merge_notes(self.notes, other.notes))


@dataclass(frozen=True, eq=False, repr=False)
class NormalEquations(Additive, Frozen):
    """N c = b, summed over data. They add: chunks, catalogues and priors alike.

    Attributes
    ----------
    modes : Modes
        What the p unknowns are.
    matrix : (p, p) array
        N = Σ Aᵀ C⁻¹ A. [(yr/µas)²]
    rhs : (p,) array
        b = Σ Aᵀ C⁻¹ y. [yr/µas]
    chi2_null : float
        Σ yᵀ C⁻¹ y, the χ² of fitting nothing.
    n_data : int
        How many measured numbers went in: two for each motion, one for each scalar. A prior adds none.
    frame : str or None
        Frame of the axes; None fits any (a prior that is the same along all axes).
    notes : tuple of str
        The notes of the fields.
    prior : NormalEquations or None
        What of N, b and χ² is no data, but was assumed.
    unit : str or None
        Unit of the values that were summed; None fits any (a prior).
    templates : tuple of TemplateField
        What may cause systematics, for `fit.background.shared`; each a sum of the modes.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> from fit import normal_equations
    >>> both = normal_equations(field[:200], 1) + normal_equations(field[200:], 1)
    >>> both.n_data, both.matrix.shape
    (1000, (6, 6))
    >>> bool(np.allclose(both.matrix, normal_equations(field, 1).matrix))
    True
    """

    modes: Modes
    matrix: FloatArray
    rhs: FloatArray
    chi2_null: float
    n_data: int
    frame: str | None = None
    notes: tuple[str, ...] = ()
    prior: NormalEquations | None = None
    unit: str | None = "µas/yr"
    templates: tuple[TemplateField, ...] = ()

    def __repr__(self) -> str:
        prefix = "scalar, " if isinstance(self.modes, ScalarModes) else ""
        return (
            f"<NormalEquations: {self.n_data} numbers, {prefix}degree {self.modes.lmax}, {self.frame or 'any frame'}>"
        )

    @property
    def n_sources(self) -> int:
        """Number of sources."""
        return self.n_data // self.modes.components

    def _add_with_sign(self, other, sign):
        if not isinstance(other, NormalEquations):
            return NotImplemented
        if other.modes != self.modes:
            degree, other_degree = (
                modes.lmax if type(self.modes) is type(other.modes) else modes for modes in (self.modes, other.modes)
            )
            raise ModesError(
                f"normal equations of degree {degree} and {other_degree} cannot be added: use the same lmax for both"
            )
        if None not in (self.unit, other.unit) and self.unit != other.unit:
            raise ModesError(
                f"cannot add normal equations of values in {self.unit or 'no unit'} and {other.unit or 'no unit'}"
            )
        if None not in (self.frame, other.frame) and self.frame != other.frame:
            raise FrameError(
                f"cannot add normal equations in {self.frame} and {other.frame} axes: "
                f'take one field .to_frame("{self.frame}") first'
            )
        if self.templates and other.templates:
            _check_same_templates(self.templates, other.templates)
        elif other.n_data and self.n_data and (self.templates or other.templates):
            raise ModesError("cannot add normal equations with templates and without")
        return replace(
            self._combine_sums(other, sign, ("matrix", "rhs", "chi2_null", "n_data")),
            frame=self.frame or other.frame,
            prior=self._combine_priors(other, sign),
            unit=other.unit if self.unit is None else self.unit,
            templates=self.templates or other.templates,
        )

    def _combine_priors(self, other, sign):
        if other.prior is None:
            return self.prior
        no_prior = replace(other.prior, matrix=0 * other.prior.matrix, rhs=0 * other.prior.rhs, chi2_null=0.0, notes=())
        return (self.prior or no_prior)._add_with_sign(other.prior, sign)


def eliminate(
    matrix: FloatArray, rhs: FloatArray, targets: ArrayLike, nuisance: ArrayLike, variances: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Eliminate the unknowns `nuisance` from N and b: those of the `targets`, and the decrease of χ².

    Parameters
    ----------
    matrix, rhs : (p, p) and (p,) arrays
        N and b.
    targets, nuisance : indices or masks
        Which of the p unknowns; those in neither are zero.
    variances : array, optional
        Variances of a Gaussian prior around zero on the nuisance unknowns; none by default.

    Notes
    -----
    The Schur complement N' = N − N_kf M⁻¹ N_fk with M = N_ff + P⁻¹; M⁻¹ = √P (1 + √P N_ff √P)⁻¹ √P bears P = 0.
    """
    targets, nuisance = (
        np.flatnonzero(index) if np.asarray(index).dtype == bool else np.asarray(index) for index in (targets, nuisance)
    )
    nuisance_matrix, cross = matrix[np.ix_(nuisance, nuisance)], matrix[np.ix_(nuisance, targets)]
    sides, root = np.column_stack([cross, rhs[nuisance]]), None if variances is None else np.sqrt(variances)[:, None]
    if root is None:
        solution = cho_solve(cho_factor(nuisance_matrix), sides)
    else:
        solution = root * cho_solve(cho_factor(np.eye(len(nuisance)) + root * nuisance_matrix * root.T), root * sides)
    schur = matrix[np.ix_(targets, targets)] - cross.T @ solution[:, :-1]
    return (schur + schur.T) / 2, rhs[targets] - cross.T @ solution[:, -1], float(rhs[nuisance] @ solution[:, -1])


def gaussian_prior(
    modes: Modes | int, sigma: ArrayLike, mean: ArrayLike = 0.0, *, frame: str | None = None
) -> NormalEquations:
    """The prior c ~ N(mean, sigma²), as normal equations without data, to be added to those of sources.

    Parameters
    ----------
    modes : Modes or ScalarModes, or the degree lmax of vector fields
        What to fit.
    sigma : float or (p,) array
        Standard deviations; inf says nothing [µas/yr]
    mean : float or (p,) array
        [µas/yr]
    frame : str, optional
        Frame of the axes, where the prior knows directions.

    Raises
    ------
    ModesError
        If a sigma is not positive.

    Examples
    --------
    >>> from fit import solve
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> from fit import normal_equations
    >>> free = solve(normal_equations(field, 2))
    >>> held = solve(normal_equations(field, 2) + gaussian_prior(2, 1.0))
    >>> bool((held.sigma < free.sigma).all())
    True
    """
    modes = as_modes(modes, None)
    sigma = float_array("sigma", sigma, (len(modes),), finite=False, broadcast=True)
    mean = float_array("mean", mean, (len(modes),), broadcast=True)
    if not (sigma > 0).all():
        raise ModesError("the standard deviations of a prior must be positive")
    weight = 1 / sigma**2
    equations = NormalEquations(modes, np.diag(weight), weight * mean, float(weight @ mean**2), 0, frame, unit=None)
    return replace(equations, prior=equations)


def _check_same_templates(one, other):
    """Raise ModesError where two sets of templates differ."""
    names = [[field.name for field in templates] for templates in (one, other)]
    if names[0] != names[1] or not all(np.array_equal(a.values, b.values) for a, b in zip(one, other, strict=True)):
        raise ModesError("cannot add normal equations of different templates: give all of them the same maps")
