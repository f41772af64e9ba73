"""Noise that the catalogue's errors leave out, estimated together with the fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fit.normal import NormalEquations, Template, normal_equations
from fit.quality import ErrorSource
from fit.solution import AboutSolution, Solution
from fit.solving import solve
from fit.sums import sandwich, weighted_sums
from vsh.field import Field
from vsh.io.parts import Parts, as_parts
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import ConvergenceError
from vsh.tools.logs import logged


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

    def equations(
        self, field: Field | Parts, modes: Modes | int, *, templates: Sequence[Template] = ()
    ) -> NormalEquations:
        """Sum normal equations of some of its sources, a class say, with the errors that this fit found.

        Parameters
        ----------
        field, modes, templates
            As for `Reweighted.equations`.
        """
        enlarged = as_parts(field).map(_Enlarged(self.excess_noise**2, self.scale**2))
        return normal_equations(enlarged, as_modes(modes), templates=templates)


@logged("excess noise")
@arguments.accepts(field=arguments.a(Field, Parts), tolerance=arguments.positive, max_rounds=arguments.whole)
def excess_noise(
    field: Field | Parts, modes: Modes | int, *, scale: bool = False, tolerance: float = 1e-4, max_rounds: int = 100
) -> ExcessNoise:
    """Fit with C + s² I for every source's covariance, s by restricted maximum likelihood.

    Parameters
    ----------
    field : Field or Parts
        The sources. Parts are gone through once for each trial of s.
    modes : Modes, or the degree lmax
        What to fit.
    scale : bool
        Estimate a factor f on the catalogue's errors as well: f² C + s² I.
    tolerance : float
        To which the likelihood is maximised, in units of the error of s² and f².
    max_rounds : int
        Largest number of rounds.

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
    modes, sky = as_modes(modes), as_parts(field)
    problem = _Restricted(sky, modes, bool(scale))
    parameters = problem.maximum(max_rounds, tolerance)
    _, slope = problem.loss(parameters)
    errors = problem.errors(parameters)
    free = parameters > 0
    steps = slope * problem.n_sources * errors  # to the maximum, in errors
    if np.any(np.abs(steps[free]) > 0.05) or np.any(steps[~free] < -0.05):
        if scale and parameters[0] > 100:
            raise ConvergenceError(
                f"beside an excess noise {np.sqrt(parameters[0]):.3g} times as large as the errors no factor on them "
                "can be told: fit without one (scale=False, --method excess-noise)"
            )
        away = ", ".join(f"{step:+.2g}" for step in steps)
        raise ConvergenceError(
            f"the excess noise has not settled after {problem.n_rounds} fits: it is {away} of its errors from the "
            f"maximum of the likelihood; allow more than max_rounds={max_rounds}"
        )
    unit = problem.unit
    enlarged = sky.map(problem.enlarged(parameters))
    solution = solve(problem.sums(parameters)["normal"])
    covariance = sandwich(enlarged, partial(_scores, solution=solution), modes)
    noise = unit * np.sqrt(parameters[0])
    # From the variance s² to s; at the boundary s = 0 the error is the s at one error of s².
    noise_error = unit**2 * errors[0] / (2 * noise) if parameters[0] > errors[0] / 4 else unit * np.sqrt(errors[0])
    factor = float(np.sqrt(parameters[1])) if scale else 1.0
    factor_error = float(errors[1] / (2 * factor)) if scale else 0.0
    note = f"excess noise: {noise:.4g} ± {noise_error:.2g} µas/yr added in quadrature to every component"
    if scale:
        note += f", after scaling the errors by {factor:.3f} ± {factor_error:.3f}"
    solution = replace(
        solution,
        covariance=covariance,
        formal_covariance=solution.covariance,
        notes=(*solution.notes, note),
        errors_from="the residuals, source by source, with excess noise",
        error_source=ErrorSource.EXCESS_NOISE,
    )
    return ExcessNoise(solution, float(noise), float(noise_error), factor, factor_error, problem.n_rounds)


def _scores(field, solution):
    ones = np.ones(len(field))
    return solution.residuals(field).data, ones, ones


@dataclass(frozen=True)
class _Enlarged:
    """A step: the field with errors f² C + s² I."""

    noise: float
    factor: float

    def __call__(self, field):
        (s1, s2), rho = field.sigma, field.rho
        sigma = np.sqrt(self.factor * field.sigma**2 + self.noise)
        return field.with_errors(sigma, self.factor * rho * s1 * s2 / (sigma[0] * sigma[1]))


def _size(field):
    return len(field), float(field.information.sum())


def _sums(field, enlarged, modes):
    """All that the likelihood needs of some sources."""
    field = enlarged(field)
    a, b, c = field.weights
    # 1 − s² W, the share of the catalogue's own errors: from sums of W it would be lost to rounding where s is large.
    own = np.stack([1 - enlarged.noise * a, 1 - enlarged.noise * b, -enlarged.noise * c])
    (s1, s2), rho = field.sigma, field.rho
    squared = np.stack([a * a + c * c, b * b + c * c, c * (a + b)])
    # C⁻¹ ∂C: W for s², (1 − s² W)/f² for f². Their products' traces are the expected information.
    return {
        "normal": normal_equations(field, modes),
        "squared": weighted_sums(field, squared, modes),
        "logdet": float(np.sum(2 * np.log(s1 * s2) + np.log1p(-(rho**2)))),
        "trace": float(np.sum(a + b)),
        "trace of squares": float(np.sum(squared[0] + squared[1])),
        "cross": float(np.sum(a * own[0] + b * own[1] + 2 * c * own[2])),
        "own": float(np.sum(own[0] ** 2 + own[1] ** 2 + 2 * own[2] ** 2)),
    }


class _Restricted:
    """−ln of the restricted likelihood a source, of s² (in units of the mean variance by weight) and f²."""

    def __init__(self, sky, modes, scale):
        self.sky, self.modes, self.scale = sky, modes, scale
        self.n_sources, information = sky.sum(_size, roles=(), words="excess noise")
        self.unit = float(np.sqrt(2 * self.n_sources / information))
        self.n_rounds = 0
        self.last: tuple[Any, Any] = (None, None)

    def enlarged(self, parameters):
        """The step to the field with errors f² C + s² I."""
        return _Enlarged(float(parameters[0]) * self.unit**2, float(parameters[1]) if self.scale else 1.0)

    def sums(self, parameters):
        """Those over all sources, kept for whoever asks for the same again."""
        key = tuple(map(float, parameters))
        if key != self.last[0]:
            self.n_rounds += 1
            work = partial(_sums, enlarged=self.enlarged(parameters), modes=self.modes)
            self.last = key, self.sky.sum(work, roles=(), words=f"excess noise, trial {self.n_rounds}")
        return self.last[1]

    def loss(self, parameters):
        """Value and gradient."""
        sums = self.sums(parameters)
        normal, n = sums["normal"], self.n_sources
        solution = solve(normal)
        values = solution.values
        value = (sums["logdet"] + solution.chi2 + np.linalg.slogdet(normal.matrix)[1]) / 2
        # With W = C⁻¹ and ∂C/∂s² = I: ½ [tr W − |Wr|² − tr(N⁻¹ Σ AᵀW²A)], r = y − A c.
        matrix, rhs, square = sums["squared"]
        pulled = square - 2 * values @ rhs + values @ matrix @ values
        by_noise = (sums["trace"] - pulled - float(np.sum(solution.covariance * matrix))) / 2
        slope = [by_noise * self.unit**2]
        if self.scale:  # ∂C/∂f² = (C − s² I)/f²
            noise = parameters[0] * self.unit**2
            slope.append(((2 * n - solution.chi2 - len(self.modes)) / 2 - noise * by_noise) / parameters[1])
        return value / n, np.array(slope) / n

    def maximum(self, max_rounds, tolerance):
        """The parameters of the largest likelihood, searched along ln(1 + s²) and ln f²."""
        begun = max(self.excess(), 1e-2)
        start = np.array([np.log1p(begun), 0.0][: 1 + self.scale])
        bounds = [(0.0, None), (np.log(1e-6), None)][: len(start)]

        def natural(x):
            return np.r_[np.expm1(x[0]), np.exp(x[1:])]

        def loss(x):
            value, slope = self.loss(natural(x))
            return value, slope * np.r_[np.exp(x[0]), np.exp(x[1:])]

        from scipy.optimize import minimize  # slow to import

        options = {"maxiter": max_rounds, "ftol": 1e-15, "gtol": tolerance / np.sqrt(self.n_sources)}
        parameters = natural(minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options).x)
        for _ in range(40):  # along a ridge, where one of the two hides the other, by Fisher's scoring
            value, slope = self.loss(parameters)
            step = -np.linalg.pinv(self.information(parameters)) @ slope * self.n_sources
            errors = self.errors(parameters)
            if not np.isfinite(errors).all():
                break
            if self.n_rounds >= max_rounds or np.all(np.abs(step) < 0.01 * errors) or parameters[0] == 0:
                break
            limits = np.array([0.0, 1e-6])[: len(step)]
            for damping in (1.0, 0.5, 0.25, 0.1, 0.03):
                trial = np.maximum(parameters + damping * np.clip(step, -2 * errors, 2 * errors), limits)
                if self.loss(trial)[0] <= value:
                    break
            parameters = trial
        return parameters

    def excess(self):
        """s² by which χ² of the plain fit would be as expected, about, in units of the mean variance."""
        normal = self.sums(np.array([0.0, 1.0]))["normal"]
        solution = solve(normal)
        return solution.chi2 / max(solution.dof, 1) - 1

    def errors(self, parameters):
        """Standard errors from the expected information of as many sources as the coefficients leave."""
        return np.sqrt(np.diag(np.linalg.pinv(self.information(parameters))))

    def information(self, parameters):
        """The expected information of the parameters."""
        sums, n = self.sums(parameters), self.n_sources
        information = np.array([[self.unit**4 * sums["trace of squares"]]])
        if self.scale:
            cross = self.unit**2 * sums["cross"] / parameters[1]
            own = sums["own"] / parameters[1] ** 2
            information = np.array([[information[0, 0], cross], [cross, own]])
        share = max(1 - len(self.modes) / (2 * n), 1e-3)
        return information / 2 * share
