"""Noise that the catalogue's errors leave out, estimated together with the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from fit.normal import normal_equations
from fit.solution import AboutSolution, Solution
from fit.solve import solve
from fit.sums import sandwich, weighted_matrix
from vsh.checks import arguments
from vsh.errors import ConvergenceError
from vsh.field import Field
from vsh.modes import Modes, as_modes


@dataclass(frozen=True, eq=False)
class ExcessNoise(AboutSolution):
    """A fit with a variance added to every source.

    Attributes
    ----------
    solution : Solution
        Its covariance holds the scatter of the residuals, source by source.
    excess_noise, excess_noise_error : float
        Standard deviation added in quadrature to both components, and its error. [µas/yr]
    scale, scale_error : float
        Factor on the catalogue's errors; 1 and 0 unless it was asked for.
    n_rounds : int
        How many fits it took.
    """

    solution: Solution
    excess_noise: float
    excess_noise_error: float
    scale: float
    scale_error: float
    n_rounds: int


@arguments.accepts(field=arguments.a(Field), tolerance=arguments.positive, max_rounds=arguments.whole)
def excess_noise(
    field: Field, modes: Modes | int, *, scale: bool = False, tolerance: float = 1e-4, max_rounds: int = 100
) -> ExcessNoise:
    """Fit with C + s² I for every source's covariance, s by restricted maximum likelihood.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    scale : bool
        Estimate a factor f on the catalogue's errors as well: f² C + s² I.
    tolerance : float
        To which the likelihood is maximised, in units of the error of s² and f².
    max_rounds : int
        Of the iteration.

    Returns
    -------
    ExcessNoise

    Raises
    ------
    ConvergenceError
        If s has not settled.

    Notes
    -----
    The restricted likelihood (Patterson & Thompson 1971, Biometrika 58, 545) counts the p fitted
    coefficients: s is unbiased however few sources there are to a coefficient. The covariance of the
    coefficients is a sandwich, right also where errors are wrong by different factors at different places
    (pulls within 5 % at degree 6 on 400 sources, and with errors 5 times too small on half the sky). It is
    not right where errors of neighbours are correlated: `fit.resample` tells.
    """
    modes = as_modes(modes)
    problem = _Restricted(field, modes, bool(scale))
    start = np.array([1e-2, 1.0][: 1 + bool(scale)])
    bounds = [(0.0, None), (1e-6, None)][: len(start)]
    options = {"maxiter": max_rounds, "ftol": 1e-15, "gtol": tolerance / np.sqrt(len(field))}
    found = minimize(problem.loss, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
    parameters = found.x
    _, slope = problem.loss(parameters)
    errors = problem.errors(parameters)
    free = parameters > 0
    steps = slope * len(field) * errors  # to the maximum, in errors
    if np.any(np.abs(steps[free]) > 0.05) or np.any(steps[~free] < -0.05):
        raise ConvergenceError(f"the excess noise has not settled after {problem.n_rounds} fits ({found.message})")
    unit = problem.unit
    enlarged = problem.enlarged(parameters)
    solution = solve(normal_equations(enlarged, modes))
    ones = np.ones(len(field))
    covariance, _ = sandwich(enlarged, modes, solution.residuals(enlarged).motion, ones, ones)
    noise = unit * np.sqrt(parameters[0])
    # From the variance s² to s; at the boundary s = 0 the error is the s at one error of s².
    noise_error = unit**2 * errors[0] / (2 * noise) if parameters[0] > errors[0] / 4 else unit * np.sqrt(errors[0])
    factor = float(np.sqrt(parameters[1])) if scale else 1.0
    factor_error = float(errors[1] / (2 * factor)) if scale else 0.0
    said = f"excess noise: {noise:.4g} ± {noise_error:.2g} µas/yr added in quadrature to every component"
    if scale:
        said += f", after scaling the errors by {factor:.3f} ± {factor_error:.3f}"
    solution = replace(
        solution,
        covariance=covariance,
        notes=(*solution.notes, said),
        errors_from="the residuals, source by source, with excess noise",
    )
    return ExcessNoise(solution, float(noise), float(noise_error), factor, factor_error, problem.n_rounds)


class _Restricted:
    """−ln of the restricted likelihood a source, of s² (in units of the median variance) and f²."""

    def __init__(self, field, modes, scale):
        self.field, self.modes, self.scale = field, modes, scale
        self.unit = float(np.sqrt(np.median(field.sigma**2)))
        self.n_rounds = 0

    def enlarged(self, parameters):
        """The field with errors f² C + s² I."""
        (s1, s2), rho = self.field.sigma, self.field.rho
        noise, factor = parameters[0] * self.unit**2, parameters[1] if self.scale else 1.0
        sigma = np.sqrt(factor * self.field.sigma**2 + noise)
        return self.field.with_errors(sigma, factor * rho * s1 * s2 / (sigma[0] * sigma[1]))

    def loss(self, parameters):
        """Value and gradient."""
        self.n_rounds += 1
        field = self.enlarged(parameters)
        normal = normal_equations(field, self.modes)
        solution = solve(normal)
        residual = solution.residuals(field)
        a, b, c = field.weights
        (s1, s2), rho = field.sigma, field.rho
        chi2 = residual.chi2
        log_det = 2 * np.log(s1 * s2) + np.log1p(-(rho**2))
        n = len(field)
        value = (log_det.sum() + chi2.sum() + np.linalg.slogdet(normal.matrix)[1]) / 2
        # With W = C⁻¹ and ∂C/∂s² = I: ½ [tr W − |Wr|² − tr(N⁻¹ Σ AᵀW²A)].
        east, north = residual.motion
        pulled = (a * east + c * north) ** 2 + (c * east + b * north) ** 2
        squared = np.stack([a * a + c * c, b * b + c * c, c * (a + b)])
        within = float(np.sum(solution.covariance * weighted_matrix(field, squared, self.modes)))
        by_noise = (np.sum(a + b) - pulled.sum() - within) / 2
        slope = [by_noise * self.unit**2]
        if self.scale:  # ∂C/∂f² = (C − s² I)/f²
            noise = parameters[0] * self.unit**2
            slope.append(((2 * n - chi2.sum() - len(self.modes)) / 2 - noise * by_noise) / parameters[1])
        return value / n, np.array(slope) / n

    def errors(self, parameters):
        """Standard errors of the parameters from the expected information, for as many sources as are left by the coefficients."""
        field = self.enlarged(parameters)
        a, b, c = field.weights
        noise = parameters[0] * self.unit**2
        # C⁻¹ ∂C: W for s² (in its unit), (1 − s² W)/f² for f².
        first = self.unit**2 * np.stack([a, b, c])
        parts = [first]
        if self.scale:
            parts.append(np.stack([1 - noise * a, 1 - noise * b, -noise * c]) / parameters[1])
        information = (
            np.array([[np.sum(x[0] * y[0] + x[1] * y[1] + 2 * x[2] * y[2]) for y in parts] for x in parts]) / 2
        )
        share = max(1 - len(self.modes) / (2 * len(field)), 1e-3)
        return np.sqrt(np.diag(np.linalg.pinv(information * share)))
