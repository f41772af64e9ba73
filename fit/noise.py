"""Noise that the catalogue's errors leave out, estimated together with the fit."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from fit.normal import normal_equations
from fit.solution import Solution
from fit.solve import solve
from vsh.errors import ConvergenceError


@dataclass(frozen=True, eq=False)
class ExtraNoise:
    """A fit with a variance added to every source.

    Attributes
    ----------
    solution : Solution
        Its covariance holds the enlarged errors.
    extra, extra_error : float
        Standard deviation added in quadrature to both components, and its error. [µas/yr]
    scale, scale_error : float
        Factor on the catalogue's errors; 1 and 0 unless it was asked for.
    rounds : int
    """

    solution: Solution
    extra: float
    extra_error: float
    scale: float
    scale_error: float
    rounds: int


def extra_noise(field, modes, scale=False, tolerance=1e-4, max_rounds=100):
    """Fit with C + s² I for every source's covariance, s by maximum likelihood.

    Parameters
    ----------
    field : Field
    modes : Modes
    scale : bool
        Estimate a factor f on the catalogue's errors as well: f² C + s² I.

    Returns
    -------
    ExtraNoise

    Raises
    ------
    ConvergenceError
        If s and the coefficients have not settled together.
    """
    (s1, s2), rho = field.sigma, field.rho
    c = rho * s1 * s2
    unit = float(np.sqrt(np.median(field.sigma**2)))
    residual = field

    def loss(parameters):
        """−ln L a source, of s² (in units of the median variance) and f²."""
        extra, factor = parameters[0] * unit**2, parameters[1] if scale else 1.0
        v1, v2, v12 = factor * s1**2 + extra, factor * s2**2 + extra, factor * c
        det = v1 * v2 - v12**2
        e, n = residual.motion
        return float(np.mean(np.log(det) + (v2 * e * e + v1 * n * n - 2 * v12 * e * n) / det) / 2)

    def enlarged(parameters):
        extra, factor = parameters[0] * unit**2, parameters[1] if scale else 1.0
        sigma = np.sqrt(factor * field.sigma**2 + extra)
        return field.with_errors(sigma, factor * c / (sigma[0] * sigma[1]))

    parameters = np.array([0.0, 1.0] if scale else [0.0])
    bounds = [(0.0, None), (1e-6, None)][: len(parameters)]
    solution = solve(normal_equations(field, modes))
    for rounds in range(1, max_rounds + 1):
        residual = solution.residuals(field)
        start = np.maximum(parameters, [1e-3, 1e-3][: len(parameters)])
        found = minimize(loss, start, bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-14, "gtol": 1e-9}).x
        if loss(found) > loss(np.r_[0.0, found[1:]]):
            found[0] = 0.0
        before, parameters = parameters, found
        enlarged_field = enlarged(parameters)
        old, solution = solution, solve(normal_equations(enlarged_field, modes))
        moved = np.max(np.abs(solution.coefficients.values - old.coefficients.values) / solution.sigma)
        if moved < tolerance and np.allclose(parameters, before, rtol=1e-4, atol=1e-7):
            break
    else:
        raise ConvergenceError(f"extra noise and coefficients have not settled after {max_rounds} rounds")
    errors = np.sqrt(np.diag(np.linalg.pinv(_curvature(loss, parameters) * len(field))))
    extra = unit * np.sqrt(parameters[0])
    # From the variance s² to s; at the boundary s = 0 the error is the s at one error of s².
    extra_error = unit**2 * errors[0] / (2 * extra) if extra > 0 else unit * np.sqrt(errors[0])
    factor = float(np.sqrt(parameters[1])) if scale else 1.0
    factor_error = float(errors[1] / (2 * factor)) if scale else 0.0
    said = f"extra noise: {extra:.4g} ± {extra_error:.2g} µas/yr added in quadrature to every component"
    if scale:
        said += f", after scaling the errors by {factor:.3f} ± {factor_error:.3f}"
    solution = replace(solution, notes=(*solution.notes, said), errors_from="the catalogue, with extra noise")
    return ExtraNoise(solution, float(extra), float(extra_error), factor, factor_error, rounds)


def _curvature(function, x, step=1e-3):
    """Second derivatives by central differences; one-sided from a boundary at zero."""
    x = np.maximum(x, step)
    n = len(x)
    h = step * np.maximum(x, 0.1) if n else x
    out = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            e, f = np.eye(n)[i] * h[i], np.eye(n)[j] * h[j]
            values = function(x + e + f) - function(x + e - f) - function(x - e + f) + function(x - e - f)
            out[i, j] = values / (4 * h[i] * h[j])
    return out
