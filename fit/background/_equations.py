"""What a background is fitted to: normal equations, or a solution in their place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fit.harmonic import HarmonicSolution
from fit.normal import NormalEquations
from vsh.checks.arguments import choice
from vsh.checks.notes import spoken
from vsh.checks.types import IntArray
from vsh.errors import DegeneracyError, ModesError, ParameterError
from vsh.modes import Modes

#: How errors are named that the residuals have not scaled.
QUOTED = "the catalogue"


def equations_of(found: Any) -> NormalEquations:
    """Normal equations of data alone: as they are less their prior, or those that a solution is the solution of."""
    found = _about(found)
    if isinstance(found, NormalEquations | HarmonicSolution) and found.modes.components != 2:
        raise ParameterError(
            "backgrounds are fields of motions: their spectra have toroidal and spheroidal parts, and a scalar field has neither"
        )
    if isinstance(found, NormalEquations):
        return found if found.prior is None else found - found.prior
    if not isinstance(found, HarmonicSolution):
        raise ParameterError(
            f"a background is fitted to normal equations or to a Solution, not to a {type(found).__name__}: "
            "fit.normal_equations(field, modes)"
        )
    if getattr(found, "by_prior", 0.0):
        raise ParameterError(
            "this solution holds a prior: give the normal equations of the data, fit.normal_equations(field, modes)"
        )
    if found.covariance_dof < len(found.modes):
        raise DegeneracyError(
            f"{found.covariance_dof + 1:.0f} replicates determine no covariance of {len(found.modes)} coefficients: "
            "take more of them, or a lower degree"
        )
    if np.isnan(found.values).any():
        raise ParameterError("a prediction holds no data to fit a background to")
    scale = np.outer(found.sigma, found.sigma)
    try:
        matrix = cho_solve(cho_factor(found.covariance / scale), np.eye(len(scale))) / scale
    except np.linalg.LinAlgError:
        raise DegeneracyError(
            "the covariance of this solution is singular: no background can be fitted to it"
        ) from None
    rhs = matrix @ found.values
    chi2_null = float(found.chi2 + rhs @ found.values)
    return NormalEquations(found.modes, matrix, rhs, chi2_null, found.n_data, found.frame, spoken(found.notes))


def errors_of(found: Any) -> str:
    """Where the errors come from; where from the catalogue alone, χ² tells their scale."""
    return getattr(_about(found), "errors_from", QUOTED)


def is_scaled(found: Any, noise_scale: bool | None) -> bool:
    """Whether the scale of the errors is estimated: as told, or where the errors are the catalogue's."""
    told = choice("noise_scale", noise_scale, (None, True, False))
    return errors_of(found) == QUOTED if told is None else told


def fitted_degrees(modes: Modes, degrees: Any, name: str = "degrees") -> tuple[int, ...]:
    """Degrees that are among those fitted, in order, each once."""
    try:
        listed = list(degrees) if isinstance(degrees, Iterable) else [degrees]
        found = sorted({int(each) for each in listed if int(each) == each})
    except (TypeError, ValueError, OverflowError, np.ma.MaskError):
        found = []
    if not found or len(found) != len(set(listed)):
        raise ModesError(f"{name} must be whole numbers from 1 on, one at least, not {degrees!r}")
    missing = [each for each in found if not 1 <= each <= modes.lmax]
    if missing:
        raise ModesError(f"degree {missing[0]} is not fitted: these normal equations go from degree 1 to {modes.lmax}")
    return tuple(found)


def places(modes: Modes, degrees: Iterable[int]) -> IntArray:
    """Where the coefficients of some degrees are stored."""
    return np.flatnonzero(np.isin(modes.degrees, list(degrees)))


def words_of(degrees: Sequence[int]) -> str:
    """Degrees as a reader sees them: "2, 3", "2 to 7"."""
    degrees = list(degrees)
    if len(degrees) > 2 and degrees == list(range(degrees[0], degrees[-1] + 1)):
        return f"{degrees[0]} to {degrees[-1]}"
    return ", ".join(map(str, degrees))


def _about(found):
    return getattr(found, "resampled_solution", getattr(found, "solution", found))
