"""The solution of normal equations."""

from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.linalg.lapack import dpocon

from fit.normal._coverage import add_coverage_notes
from fit.normal._equations import NormalEquations
from fit.normal._sum import normal_equations
from fit.results.solution import ScalarSolution, Solution
from vsh import Coefficients, Field
from vsh.io.parts import Parts
from vsh.models.covariance import Covariance
from vsh.modes import Modes, ScalarModes
from vsh.scalars import ScalarCoefficients, ScalarField, modes_for
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.notes import drop_empty_notes
from vsh.tools.printing import log_calls
from vsh.tools.types import FloatArray

_ROUNDING_NOTE = "warning: values are a million times their errors, so χ² is lost to rounding: take a model away first"
#: The degree unless another is named.
_DEGREE = 3
#: Beyond this condition number of the scaled matrix, fewer than six digits are left.
MAX_CONDITION = 1e10


@log_calls("solved")
@arguments.accepts(prior=arguments.a(NormalEquations), max_condition=arguments.positive)
def solve(
    normal: NormalEquations,
    prior: NormalEquations | None = None,
    *,
    floor: Any = None,
    max_condition: float = MAX_CONDITION,
) -> Solution:
    """Solve normal equations for the coefficients and their covariance.

    Parameters
    ----------
    normal : NormalEquations
        What to solve.
    prior : NormalEquations, optional
        Normal equations of a prior, e.g. `fit.gaussian_prior(…)`, added to `normal`.
    floor : Floor, optional
        Systematic floor returned by `fit.background.floor(normal)`: it gives a prior on the higher degrees and is
        included in the errors of degree 1. The attribute `errors_from` records this.
    max_condition : float
        Largest allowed 1-norm condition number of the normal matrix scaled to unit diagonal.

    Returns
    -------
    Solution
        A ScalarSolution of a scalar field.

    Raises
    ------
    DegeneracyError
        If the condition number exceeds `max_condition`: the sources do not determine some combination of modes.

    Examples
    --------
    >>> from vsh import Field, Modes
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 100), np.arcsin(rng.uniform(-1, 1, 100))
    >>> spin = Coefficients.from_vectors(rotation=(1, 2, 3)).at(lon, lat)
    >>> field = Field(lon, lat, spin, np.ones((2, 100)))
    >>> solve(normal_equations(field, Modes(1))).spin.value.round(9)
    array([1., 2., 3.])
    """
    if not isinstance(normal, NormalEquations):
        raise ParameterError(
            f"solve takes normal equations, not a {type(normal).__name__}: fit.normal_equations(field, modes)"
        )
    if floor is not None:
        if not hasattr(floor, "allowed_for"):
            raise ParameterError(f"floor is what fit.background.floor(normal) gives, not a {type(floor).__name__}")
        return floor.allowed_for(partial(solve, prior=prior, max_condition=max_condition), normal)
    if prior is not None:
        normal = normal + prior
    factor, scales = _factorise_scaled_matrix(normal, max_condition)
    covariance = cho_solve(factor, np.diag(scales)) * scales[:, None]
    values = scales * cho_solve(factor, scales * normal.rhs)
    chi2, notes = float(normal.chi2_null - values @ normal.rhs), drop_empty_notes(normal.notes)
    if normal.templates:
        names = ", ".join(template.name for template in normal.templates)
        notes = (*notes, f"templates are not in this fit, but in that of fit.background.shared: {names}")
    by_prior = 0.0
    if (total_prior := normal.prior) is not None:
        by_prior = float(np.sum(covariance * total_prior.matrix))
        chi2 -= float(total_prior.chi2_null - 2 * values @ total_prior.rhs + values @ total_prior.matrix @ values)
    if chi2 < 1e-11 * normal.chi2_null and normal.n_data > len(normal.modes):
        # The difference of two numbers that are equal to eleven digits.
        chi2, notes = max(chi2, 0.0), (*notes, _ROUNDING_NOTE)
    common: dict[str, Any] = {
        "covariance": (covariance + covariance.T) / 2,
        "chi2": chi2,
        "n_data": normal.n_data,
        "frame": normal.frame or "icrs",
        "notes": notes,
        "by_prior": by_prior,
    }
    if isinstance(normal.modes, ScalarModes):
        return ScalarSolution(coefficients=ScalarCoefficients(normal.modes, values), **common, unit=normal.unit or "")
    return Solution(coefficients=Coefficients(normal.modes, values), **common, unit=normal.unit or "µas/yr")


@arguments.accepts()
def fit_field(
    field: Any,
    modes: Modes | int | None = None,
    *,
    lmax: int | None = None,
    covariance: Covariance | FloatArray | None = None,
) -> Solution:
    """Fit all modes to a degree to a field by linear least squares: normal equations, solved.

    Its errors are formal ones. The fit to quote is `fit.recommended`.

    Parameters
    ----------
    field : Field, ScalarField, iterable of Fields, path or table
        The sources; a path or a table is read by `vsh.read_field`.
    modes : Modes, or the degree lmax
        What to fit; ScalarModes of a ScalarField.
    lmax : int, optional
        The degree, in place of `modes`; 3 unless either is given.
    covariance : Covariance or (2n, 2n) array, optional
        As for `normal_equations`.

    Raises
    ------
    DegeneracyError
        If the sources cannot separate the modes.
    ParameterError
        If both modes and a degree are given.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> solution = fit_field(field, 3)
    >>> solution.values.shape
    (30,)
    """
    if modes is not None and lmax is not None:
        raise ParameterError("what is to be fitted: modes, or the degree lmax, one of the two")
    modes_or_degree = modes if modes is not None else _DEGREE if lmax is None else lmax
    if not isinstance(field, Field | ScalarField | Parts):
        from vsh.io.catalogue import as_field, is_readable

        field = as_field("field", field) if is_readable(field) else field
    if isinstance(field, Field | ScalarField):
        modes_or_degree = modes_for(field, modes_or_degree)
        if modes_or_degree.components * len(field) < len(modes_or_degree):
            raise DegeneracyError(_format_degeneracy_message(len(field), modes_or_degree))
    return add_coverage_notes(solve(normal_equations(field, modes_or_degree, covariance=covariance)), field)


def _format_degeneracy_message(n_sources, modes, reason=""):
    hint = f"lower lmax from {modes.lmax} (--lmax), or " if modes.lmax > 1 else ""
    return (
        f"{n_sources} sources cannot separate {len(modes)} modes{reason}: {hint}add sources, in other parts of the sky "
        "(in Python normal equations know priors, too: fit.gaussian_prior)"
    )


def _factorise_scaled_matrix(normal, max_condition):
    """Factorise N scaled to a unit diagonal: its Cholesky factor, and the scale."""
    diagonal, reciprocal_condition, weakest_modes = np.diag(normal.matrix), 0.0, ""
    if (normal.n_data or normal.prior is not None) and (diagonal > 0).all():
        scale = 1 / np.sqrt(diagonal)
        matrix = normal.matrix * np.outer(scale, scale)
        with suppress(np.linalg.LinAlgError):
            factor = cho_factor(matrix, lower=True)
            reciprocal_condition, _ = dpocon(factor[0], np.abs(matrix).sum(0).max(), uplo="L")
        if reciprocal_condition * max_condition > 1:
            return factor, scale
        weakest_modes = _describe_weakest_modes(matrix, normal.modes)
    condition = 1 / reciprocal_condition if reciprocal_condition else np.inf
    reason = f" (condition {condition:.1e} > {max_condition:.0e}{weakest_modes})"
    raise DegeneracyError(_format_degeneracy_message(normal.n_sources, normal.modes, reason))


def _describe_weakest_modes(matrix, modes, count=4):
    """Describe the modes that make up the combination the data see least."""
    weakest_vector = eigh(matrix, subset_by_index=[0, 0])[1][:, 0]
    largest_indices = np.argsort(-np.abs(weakest_vector))[:count]
    names = [str(mode) for mode in modes]
    return ", worst in " + ", ".join(names[i] for i in largest_indices)
