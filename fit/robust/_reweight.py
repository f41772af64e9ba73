"""Fits whose likelihood expects that some errors are wrong.

Each is the chain, called again and again on a field whose errors grow where the last fit
left large residuals, X² = Δᵀ C⁻¹ Δ of both components together.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import digamma, gammaln, polygamma

from fit.normal import NormalEquations, Template, normal_equations, solve, template_fields
from fit.normal.sums import sandwich, slice_blocks, weighted_matrix
from fit.results.quality import ERRORS_TOO_SMALL, TOO_LITTLE_SCATTER, ErrorSource
from fit.results.solution import AboutSolution, Solution, with_errors
from fit.robust._clip import EnlargedErrors
from vsh.field import Field, SourcesWithErrors, multiply_weights
from vsh.io.parts import Parts, apply_step, as_parts, sample_of
from vsh.modes import Modes, as_modes
from vsh.scalars import ScalarField, modes_for
from vsh.tools import arguments
from vsh.tools.errors import ConvergenceError, DegeneracyError, VshError
from vsh.tools.notes import CodedNote
from vsh.tools.printing import log_calls, one_line_text
from vsh.tools.types import FloatArray

#: What notes, progress and the log call it.
_LABEL = "Student-t"
#: The largest number of Newton steps for a source's leverage; with thousands of sources three suffice.
_MOST_SHARE_STEPS = 10
#: Chebyshev nodes in ln ν at which the likelihood is evaluated; interpolation is accurate to 1e-12.
_LOG_NU_NODES = chebyshev.chebpts1(36)
#: No catalogue has errors that are so many times too large.
_LEAST_INFLATION = 0.3
#: The range of ln ν.
_LOW, _HIGH = np.log([0.5, 200.0])
#: Below it the quoted errors say so little of the scatter that those of a fit by them are too small.
_LEAST_NU = 1.3


def _solve_own_share_by_steps(t_weights, chi2, unit_share):
    """Newton's steps to where share and weight agree: it depends on u, and u on it, the less the larger it is."""
    share = np.zeros(len(chi2))
    for _ in range(_MOST_SHARE_STEPS):
        x2 = chi2 / (1 - share)
        u, slope = t_weights(x2)
        step = (np.minimum(unit_share * u, 0.9) - share) / (1 - unit_share * slope * x2 / (1 - share))
        share = np.clip(share + step, 0.0, 0.9)
        if np.max(np.abs(step)) < 1e-13:
            break
    return share


@dataclass(frozen=True)
class StudentT:
    """Weights of the multivariate t distribution, and their derivatives with respect to X²."""

    nu: float
    estimated: bool
    components: int = 2
    step: float = 0.0

    def __call__(self, x2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The weights u and du/dX², both of shape (n,)."""
        u = (self.nu + self.components) / (self.nu + x2)
        return u, -u / (self.nu + x2)

    def solve_own_share(self, chi2: FloatArray, unit_share: FloatArray) -> FloatArray:
        """The share s of each source in its own fit, (n,), at the weight of X²/(1 − s).

        It solves s (ν + X²/(1 − s)) = s₁ (ν + k), a quadratic equation, where s₁ is the share of a weight of 1; by
        steps where a share may come near its cap.
        """
        right_side = unit_share * (self.nu + self.components)
        if right_side.max() > self.nu / 2:
            return _solve_own_share_by_steps(self, chi2, unit_share)
        b = self.nu + chi2 + right_side
        return np.asarray(2 * right_side / (b + np.sqrt(b**2 - 4 * self.nu * right_side)), float)

    def take_newton_step(self, sums: dict[str, Any], n: int) -> tuple[StudentT, float]:
        """Newton's step of ν, from sums over n sources at the current ν, and how many of its errors it is long."""
        if not self.estimated:
            return self, 0.0
        nu, k = self.nu, self.components
        mean_log, mean_tail, slope = (sums[name] / n for name in ("log", "beyond", "slope of beyond"))
        # Derivatives of `_compute_mean_log_density` in ν.
        constant = (digamma((nu + k) / 2) - digamma(nu / 2) - k / nu) / 2
        constant_slope = (polygamma(1, (nu + k) / 2) - polygamma(1, nu / 2)) / 4 + k / nu**2 / 2
        slope_in_nu = constant - mean_log / 2 + (nu + k) / (2 * nu) * mean_tail
        second = constant_slope + mean_tail / (2 * nu) - k / (2 * nu**2) * mean_tail - (nu + k) / (2 * nu) * slope
        # By τ = 1/ν, in which the mean is nearly a parabola from Gaussian errors on.
        gradient, curvature = -(nu**2) * slope_in_nu, nu**4 * second + 2 * nu**3 * slope_in_nu
        step = -gradient / curvature if curvature < 0 else np.sign(gradient)
        tau = np.clip(1 / nu + step, max(1 / nu / _FARTHEST, np.exp(-_HIGH)), min(_FARTHEST / nu, np.exp(-_LOW)))
        return replace(self, nu=float(1 / tau)), float(abs(tau - 1 / nu) * np.sqrt(n * abs(curvature)))

    def fit_nu(self, sky: Parts, weigher: SourceWeights, words: str) -> StudentT:
        """Update the weights with the likeliest ν, from the residuals and leverages at the current ν."""
        if not self.estimated:
            return self
        n, log_sums = sky.sum(partial(_count_and_sum_logs_at_nodes, weigher=weigher), roles=(), words=words)
        log_step = float(np.log(_find_likeliest_nu(log_sums / n, self.components) / self.nu))
        if log_step * self.step < 0:  # ν that turns back would swing about where it settles, and may do so for ever
            log_step /= 2
        return replace(self, nu=self.nu * float(np.exp(log_step)), step=log_step)


@dataclass(frozen=True)
class SourceWeights:
    """Weights of the sources: for each: its residual from a solution, and its share in its own fit."""

    solution: Solution
    weight: Any
    leverage: float
    #: The sources for which it was computed last with what it gave, a pair: errors and weights ask for the same again.
    last: list[Any] = dataclass_field(default_factory=list, init=False, repr=False)
    #: The same of the model at the sources, which does not depend on the weight.
    models: list[Any] = dataclass_field(default_factory=list, init=False, repr=False)

    def __call__(self, field: Field) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """X² over one less the share, u and its slope, each (n,); and the residuals, (components, n)."""
        cached: Any = self.last[0] if self.last else (None, None)
        if cached[0] is not field:  # a local pair: threads may compute for several parts
            field.check_frame(self.solution.frame)
            cached_model: Any = self.models[0] if self.models else (None, None)
            model = cached_model[1] if cached_model[0] is field else np.atleast_2d(self.solution.model(field))
            self.models[:] = [(field, model)]
            x2_and_weights, residual = np.empty((3, len(field))), np.empty(model.shape)
            for rows in slice_blocks(len(field)):
                residual[:, rows], _, _, *x2_and_weights[:, rows] = self.weigh_residuals(field[rows], model[:, rows])
            cached = (field, (*x2_and_weights, residual))
            self.last[:] = [cached]
        x2_weights_and_residuals: tuple[FloatArray, FloatArray, FloatArray, FloatArray] = cached[1]
        return x2_weights_and_residuals

    def weigh_residuals(self, field: Field, model: FloatArray) -> tuple[FloatArray, ...]:
        """The residuals from a model, their product with C⁻¹, tr C⁻¹, X² over one less the share, u and its slope."""
        weights = field.weights
        residual = np.atleast_2d(field.data) - model
        score = multiply_weights(weights, residual)
        information = weights[: field.components].sum(0)
        chi2 = np.einsum("kn,kn->n", residual, score)
        x2 = chi2 / (1 - self.weight.solve_own_share(chi2, self.leverage * information))
        return residual, score, information, x2, *self.weight(x2)

    def __reduce__(self):
        return SourceWeights, (self.solution, self.weight, self.leverage)


def _count_and_sum_logs_at_nodes(field, weigher):
    """Count of sources, and Σ ln(1 + X²/ν) at the nodes of ln ν."""
    x2 = weigher(field)[0]
    node_nus = np.exp(_LOW + (_HIGH - _LOW) * (_LOG_NU_NODES + 1) / 2)
    return len(x2), np.array([_sum_logarithms(1 + x2 / nu) for nu in node_nus])


def _sum_logarithms(numbers):
    """Σ ln of values of 1 or more: of products of eight, a logarithm takes as long as as many products."""
    n_grouped = len(numbers) // 8 * 8
    if not numbers.max(initial=1.0) < 1e30:
        return np.log(numbers).sum()
    return np.log(np.prod(numbers[:n_grouped].reshape(8, -1), axis=0)).sum() + np.log(numbers[n_grouped:]).sum()


def _compute_mean_log_density(nu, components, mean_log):
    """The mean of ln of the t density of k components, (1 + X²/ν)^{−(ν+k)/2} with its constant, from ⟨ln(1 + X²/ν)⟩."""
    constant = gammaln((nu + components) / 2) - gammaln(nu / 2) - components / 2 * np.log(nu)
    return constant - (nu + components) / 2 * mean_log


def _find_likeliest_nu(mean_logs, components):
    """The ν that makes the X² likeliest."""
    coefficients = chebyshev.chebfit(_LOG_NU_NODES, mean_logs, len(_LOG_NU_NODES) - 1)
    log_nu = np.linspace(_LOW, _HIGH, 4001)
    mean_log = chebyshev.chebval(2 * (log_nu - _LOW) / (_HIGH - _LOW) - 1, coefficients)
    height = _compute_mean_log_density(np.exp(log_nu), components, mean_log)
    k = int(np.clip(np.argmax(height), 1, len(height) - 2))
    rise, bend = ((height[k + 1] - height[k - 1]) / 2, height[k + 1] - 2 * height[k] + height[k - 1])
    peak_offset = np.clip(-rise / bend, -1, 1) if bend < 0 else np.sign(rise)  # of the parabola through three points
    return float(np.exp(log_nu[k] + peak_offset * (log_nu[1] - log_nu[0])))


#: The fit of many sources goes by Newton's steps, from so many on from that of a sample: of so many at least, and so
#: many for each coefficient, which has settled to this part of its errors.
_MANY, _SAMPLE, _SOURCES_PER_COEFFICIENT, _SAMPLE_TOLERANCE = 20_000, 5_000, 20, 0.1
#: Their relative accuracy, and their number at most; the factor on ν that each may have; a step that is so much of the
#: one before is slow.
_SCORE_ACCURACY, _MOST_STEPS, _FARTHEST, _SLOW_STEP_RATIO = 1e-8, 12, 4.0, 0.2
#: Rounds after which leverages are held fixed.
_ADAPTING_ROUNDS = 15


@dataclass(frozen=True, eq=False, kw_only=True)
class ReweightedFit(AboutSolution):
    """A fit in which sources with large residuals have less weight.

    Attributes
    ----------
    solution : Solution
        Its covariance is that of the residuals, source by source, not of the catalogue's errors.
    weights : (n,) array or None
        Factor on each source's inverse covariance, up to a common one; None of a catalogue in parts.
    n_rounds : int
        How many fits it took.
    inflation : float
        Standard errors over those of plain least squares with the catalogue's errors, rms over the coefficients.
    effective : float
        The number of equally weighted sources with the same weight, (Σu)²/Σu².
    nu : float or None
        Degrees of freedom of the Student-t distribution.
    share : callable
        Computes the weights of any of its sources from their residuals.
    noise : float
        Standard deviation that was added in quadrature to every error before. [µas/yr]
    log_likelihood : float
        ln of the likelihood of a Student-t fit at its maximum, up to a constant that depends on the number of sources
        alone.
    """

    solution: Solution
    weights: FloatArray | None
    n_rounds: int
    inflation: float
    effective: float
    nu: float | None = None
    share: SourceWeights | None = None
    noise: float = 0.0
    log_likelihood: float = np.nan

    def equations(
        self, field: Field | Parts, modes: Modes | int, *, templates: Sequence[Template] = ()
    ) -> NormalEquations:
        """Sum normal equations of some of its sources, a class say, by the weights of this fit.

        Parameters
        ----------
        field : Field or Parts
            Sources that were fitted.
        modes : Modes, or the degree lmax
            What the equations are for; another degree than that of the fit, if need be.
        templates : sequence of fit.background.Template
            As for `fit.normal_equations`.

        Returns
        -------
        NormalEquations
            Scaled so that N⁻¹ has the size of the covariance of the residuals: no χ² scales it again.

        Notes
        -----
        The factor is that of an M-estimator (Huber 1981, Robust Statistics, sect. 7.6), ⟨u⟩⟨ψ²⟩/⟨ψ'⟩² of the scores ψ =
        uX of these sources, weighted by their information. Residuals are multiplied by ⟨u⟩/⟨ψ'⟩, which makes the
        solution Newton's step from that of all sources: weights that are taken about the fit of all sources draw the
        values of a class towards it, by a third where ν = 1.6.
        """
        modes, sky = as_modes(modes, type(self.solution.modes)), _add_noise_to_errors(field, self.noise)
        words = "weights of the classes"
        sums = sky.sum(partial(_sum_scale_terms, weigher=self.share), roles=(), words=words)
        factor = sums["u"] * sums["ψ²"] / (modes.components * sums["ψ'"] ** 2)
        work = partial(_sum_class_equations, weigher=self.share, modes=modes, residual_stretch=sums["u"] / sums["ψ'"])
        normal = sky.sum(work, roles=(), words=words)
        scaled_terms = {name: getattr(normal, name) / factor for name in ("matrix", "rhs", "chi2_null")}
        new_templates = template_fields(templates, modes, normal.frame or "icrs") if templates else normal.templates
        return replace(normal, templates=new_templates, **scaled_terms)


@log_calls(_LABEL)
@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts),
    nu=arguments.positive,
    tolerance=arguments.positive,
    max_rounds=arguments.whole,
    noise=arguments.not_negative,
    least_nu=arguments.not_negative,
)
def student_t(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    *,
    nu: float | None = None,
    tolerance: float = 1e-4,
    max_rounds: int = 500,
    noise: float = 0.0,
    least_nu: float = 0.0,
) -> ReweightedFit:
    """Fit with a Student-t likelihood of each source's residual, both components of a motion together.

    Parameters
    ----------
    field : Field, ScalarField or Parts
        The sources. Parts are gone through once a step, and twice a round where there are few sources.
    modes : Modes, or the degree lmax
        What to fit.
    nu : float, optional
        Degrees of freedom of the distribution; estimated by maximum likelihood, between 0.5 and 200, unless given.
    tolerance : float
        The fit has settled when no coefficient moves by this fraction of its error, or would with the next Newton step.
    max_rounds : int
        Largest number of rounds; fits of many sources, from some 5000 on, take a few Newton steps.
    noise : float
        Standard deviation to add in quadrature to every error before the fit, such as that of `excess_noise`. [µas/yr]
    least_nu : float
        The fit of 20 000 sources or more begins with that of a sample: it ends there if ν is below this.

    Raises
    ------
    TailsError
        If ν of the sample is below `least_nu`.
    ConvergenceError
        If the weights have not settled.
    ParameterError
        If nu, tolerance or max_rounds is not positive, or the noise negative.

    Notes
    -----
    Weights u = (ν + k)/(ν + X²) for k components: Lange, Little & Taylor (1989, JASA 84, 881), with X² divided by one
    less the source's leverage, so that ν is estimated from residuals as large as the errors. The covariance is a
    sandwich, source by source: right for symmetric errors of any distribution at any place (pulls within 5 % at degree
    6 on 400 sources, and with errors 5 times too small on half the sky), not for systematic errors, and not
    where errors say nothing of the scatter: with the same scatter for all, pulls are 1.08 for errors from 0.2 to 1 of
    it (ν = 1.7), 1.5 from 0.05 (ν = 1.05), 6 from 0 (ν = .8). Where ν is below 1.3 a note says so; `fit.recommended`
    then adds an excess noise. Of few sources the covariance has few degrees of freedom (`covariance_dof`), which
    standard errors, p-values and limits use; and each kind and degree has its own (`block_dof`): a few sources of an
    uneven sky may decide on a vector.
    """
    modes, sky = modes_for(field, modes), _add_noise_to_errors(field, noise)
    t_weights = StudentT(4.0 if nu is None else nu, estimated=nu is None, components=modes.components)
    fit_results = _fit_plain_and_reweighted(sky, modes, t_weights, tolerance, max_rounds, least_nu)
    fitted = _make_reweighted_fit(sky, "the catalogue with the noise" if noise else "the catalogue", *fit_results)
    if noise:  # χ² is that of the catalogue's errors, as without a noise
        chi2 = as_parts(field, SourcesWithErrors).sum(partial(_sum_chi2, solution=fitted.solution), roles=())
        fitted = replace(fitted, solution=replace(fitted.solution, chi2=float(chi2)))
    log_likelihood = _compute_log_likelihood(sky, fitted.share)
    for cached_pair in (fitted.share.last, fitted.share.models):
        cached_pair.clear()
    return replace(fitted, noise=float(noise), log_likelihood=log_likelihood)


class TailsError(VshError, ValueError):
    """Tails so long that no fit without a noise will do."""


def _fit_plain_and_reweighted(sky, modes, t_weights, tolerance, max_rounds, least_nu=0.0):
    """Iterate the weighted fit until no coefficient moves by `tolerance` of its error.

    Returns the plain fit, the weighted one, its weights, the rounds, and the total weight where the last round knew it.
    """
    normal, information = sky.sum(partial(_sum_equations_and_information, modes=modes), roles=(), words=_LABEL)
    plain = solve(normal)
    if plain.n_sources >= max(_SAMPLE, 2 * _SOURCES_PER_COEFFICIENT * len(modes)):
        with suppress(ConvergenceError, DegeneracyError):
            return plain, *_fit_by_newton(sky, plain, t_weights, information, tolerance, max_rounds, least_nu)
    fit_from = partial(_fit_by_rounds, sky, plain, t_weights, information, tolerance, max_rounds)
    try:
        return plain, *fit_from(plain.values), None
    except (ConvergenceError, DegeneracyError):
        # A source that is off by millions of errors throws the plain fit far from all others.
        return plain, *fit_from(np.zeros(len(modes))), None


#: Newton's steps go to the maximum where the curvature is more than this of what the weights would give.
_LEAST_CURVATURE = 0.3


def _fit_by_newton(sky, plain, t_weights, information, tolerance, max_rounds, least_nu):
    """The weighted fit of many sources by Newton's steps, each one pass: from that of a sample, or the plain one.

    The curvature is the plain matrix times ⟨ψ'⟩, which is that of the scores but for what the residuals of a place have
    of their own: so much of a step, some hundredths, is left to the next. Where it is more, the matrix is summed anew.
    """
    n, modes = plain.n_sources, plain.modes
    if n < _MANY:
        leverage, values = len(modes) / modes.components / information, plain.values
        t_weights = t_weights.fit_nu(sky, SourceWeights(plain, t_weights, leverage), _LABEL)
    else:
        sample_sources = sample_of(sky, max(_SAMPLE, _SOURCES_PER_COEFFICIENT * len(modes), n // 100), n, draw=1)
        if not len(modes) < len(sample_sources) < n / 2:
            raise ConvergenceError(f"{len(sample_sources)} of {n} sources are no sample: are many at one place?")
        sample = as_parts(sample_sources, SourcesWithErrors)
        _, solution, weigher, _, _ = _fit_plain_and_reweighted(sample, modes, t_weights, _SAMPLE_TOLERANCE, max_rounds)
        leverage, values, t_weights = (weigher.leverage * len(sample.in_memory) / n, solution.values, weigher.weight)
        if t_weights.nu < least_nu:
            raise TailsError(f"ν = {t_weights.nu:.2g} in a sample of the sources")
    inverse, previous_change = None, 0.0
    for rounds in range(1, _MOST_STEPS + 1):
        solution = replace(plain, coefficients=replace(plain.coefficients, values=values))
        weigher, words = SourceWeights(solution, t_weights, leverage), f"{_LABEL}, step {rounds}"
        sums = sky.sum(partial(_sum_newton_terms, weigher=weigher), roles=(), words=words)
        if sums["ψ'"] < _LEAST_CURVATURE * sums["u"]:  # 0.55 and more near the maximum
            raise ConvergenceError("the likelihood is not convex here: a few sources threw the plain fit far off")
        step = plain.covariance @ sums["score"] * (sums["information"] / sums["ψ'"])
        step = step if inverse is None else inverse @ sums["score"]
        if np.abs(step / plain.sigma).max() > _SLOW_STEP_RATIO * previous_change > 0:
            inverse = np.linalg.inv(sky.sum(partial(_sum_hessian, weigher=weigher, modes=modes), roles=(), words=words))
            step = inverse @ sums["score"]
        values = values + step
        t_weights, change = t_weights.take_newton_step(sums, n)
        leverage = len(modes) / modes.components / sums["u"]
        change = max(change, float(np.max(np.abs(step) / plain.sigma)))
        if change**2 < tolerance * max(previous_change, change):  # what is left for the next step
            break
        previous_change = change
    else:
        raise ConvergenceError(f"{_LABEL} has not settled after {rounds} steps")
    solution = replace(plain, coefficients=replace(plain.coefficients, values=values))
    return solution, SourceWeights(solution, t_weights, leverage), rounds, (n, sums["u"])


def _sum_hessian(field, weigher, modes):
    """Σ Aᵀ ψ'W A: the curvature of the likelihood where the residuals are."""
    return weighted_matrix(field, field.weights * _compute_score_factors(field, weigher)[2], modes)


def _sum_newton_terms(field, weigher):
    """Σ Aᵀ u C⁻¹Δ of some sources, and what the scale of the step and that of ν follow from."""
    from vsh.transform import project_response

    field.check_frame(weigher.solution.frame)
    nu, sums = weigher.weight.nu, np.zeros(6)

    def compute_scores(model):
        scores = np.empty(model.shape)
        for rows in slice_blocks(len(field)):
            _, score, information, x2, u, slope = weigher.weigh_residuals(field[rows], model[:, rows])
            scores[:, rows] = u * score
            tail = x2 / (nu + x2)
            sums[:] += (
                information.sum(),
                information @ u,
                information @ (u + 2 / field.components * slope * x2),
                _sum_logarithms(1 + x2 / nu),
                tail.sum(),
                (tail / (nu + x2)).sum(),
            )
        return scores

    score = project_response(weigher.solution.coefficients, field.lon, field.lat, compute_scores, _SCORE_ACCURACY)
    names = ("information", "u", "ψ'", "log", "beyond", "slope of beyond")
    return {"score": score, **dict(zip(names, map(float, sums), strict=True))}


def _fit_by_rounds(sky, plain, t_weights, information, tolerance, max_rounds, values):
    """The weighted fit, its weights and the number of rounds, from values of the coefficients to begin with."""
    modes, leverage = plain.modes, len(plain.modes) / plain.modes.components / information
    solution = replace(plain, coefficients=replace(plain.coefficients, values=values))
    for rounds in range(1, max_rounds + 1):
        words = f"{_LABEL}, round {rounds}"
        weigher = SourceWeights(solution, t_weights, leverage)
        t_weights = t_weights.fit_nu(sky, weigher, words)
        cached_models = weigher.models
        weigher = SourceWeights(solution, t_weights, leverage)
        weigher.models[:] = cached_models
        sums = sky.sum(partial(_sum_weighted_equations_and_scale, weigher=weigher, modes=modes), roles=(), words=words)
        solution = solve(sums["normal"])
        if rounds <= _ADAPTING_ROUNDS:  # held fixed later, so that all settles
            leverage = len(modes) / modes.components / sums["u"]
        largest_change = np.max(np.abs(solution.values - values) / plain.sigma)
        values = solution.values
        if largest_change < tolerance:
            break
    else:
        raise ConvergenceError(
            f"the weights have not settled after {max_rounds} rounds: coefficients move by {largest_change:.1e} σ"
        )
    return solution, SourceWeights(solution, t_weights, leverage), rounds


def _make_reweighted_fit(sky, errors_name, plain, solution, weigher, rounds, count_and_weight):
    """The settled fit with the covariance of its residuals, and what is said of it."""
    compute_scores = partial(_compute_score_factors, weigher=weigher)
    covariance, dof = sandwich(sky, compute_scores, solution.modes, words=f"{_LABEL}, errors", total=count_and_weight)
    inflation = float(np.sqrt(np.mean(np.diag(covariance) / np.diag(plain.covariance))))
    summary = sky.sum(partial(_summarise_weights, weigher=weigher), roles=("name",), words=f"{_LABEL}, weights")
    effective = summary["u"] ** 2 / summary["u²"]
    largest_weight, least_weighted = max(summary["most"]), sorted(summary["least"], key=lambda pair: pair[0])[:5]
    note = (
        f"{_LABEL}: converged in {rounds} iterations; effective number of sources {effective:.1f} of "
        f"{summary['sources']}; errors are {inflation:.3g} times those that {errors_name} implies; sources with "
        f"the lowest weights: {', '.join(f'{label} ({u / largest_weight:.2g})' for u, label in least_weighted)}"
    )
    warnings = []
    if inflation < _LEAST_INFLATION:
        warning = (
            f"warning: the motions scatter so little that errors are {inflation:.2g} times those of the catalogue: are "
            "both in the units that were assumed?"
        )
        warnings.append(CodedNote(warning, TOO_LITTLE_SCATTER))
    if weigher.weight.nu is not None and weigher.weight.nu < _LEAST_NU:
        warning = (
            f"warning: ν = {weigher.weight.nu:.2g}: many of the quoted errors are several times too small for "
            "the scatter of the motions, and those of this fit may be; fit with a noise beside them (excess-noise)"
        )
        warnings.append(CodedNote(warning, ERRORS_TOO_SMALL))
    errors_from, notes = "the residuals of the robust fit, source by source", (*plain.notes, *warnings, note)
    attributes = {"chi2": summary["chi2"], "n_data": plain.n_data, "notes": notes}
    solution = with_errors(solution, covariance, errors_from, ErrorSource.RESIDUALS, dof, **attributes)
    weights = None if sky.in_memory is None else weigher(sky.in_memory)[1]
    return ReweightedFit(
        solution=solution,
        weights=weights,
        n_rounds=rounds,
        inflation=inflation,
        effective=float(effective),
        nu=weigher.weight.nu,
        share=weigher,
    )


def _add_noise_to_errors(field, noise):
    """The sources in parts, with a noise in their errors."""
    sky = as_parts(field, SourcesWithErrors)
    return apply_step(sky, EnlargedErrors(float(noise) ** 2, 1.0)) if noise else sky


def _compute_log_likelihood(sky, weigher):
    """ln of the likelihood of a Student-t fit."""
    sums = sky.sum(partial(_sum_likelihood_terms, weigher=weigher), roles=(), words=f"{_LABEL}, likelihood")
    mean = _compute_mean_log_density(weigher.weight.nu, weigher.weight.components, sums["log"] / sums["sources"])
    return float(sums["sources"] * mean - sums["logdet"] / 2)


def _sum_chi2(field, solution):
    return float(np.sum(solution.residuals(field).whitened ** 2))


def _sum_likelihood_terms(field, weigher):
    log = _sum_logarithms(1 + weigher(field)[0] / weigher.weight.nu)
    logdet = sum(field[rows].log_determinants.sum() for rows in slice_blocks(len(field)))
    return {"log": float(log), "logdet": float(logdet), "sources": len(field)}


def _sum_equations_and_information(field, modes):
    return normal_equations(field, modes), float(field.information.sum())


def _sum_weighted_equations_and_scale(field, weigher, modes):
    _, u, _, _ = weigher(field)
    normal = normal_equations(field.with_errors(field.sigma / np.sqrt(u)), modes)
    return {"normal": normal} | _sum_scale_terms(field, weigher)


def _sum_class_equations(field, weigher, modes, residual_stretch):
    """Weighted equations of some sources whose residuals are stretched."""
    _, u, _, residual = weigher(field)
    residual = residual[0] if field.components == 1 else residual
    return normal_equations(field.minus((1 - residual_stretch) * residual).with_errors(field.sigma / np.sqrt(u)), modes)


def _sum_scale_terms(field, weigher):
    """The sums that the scale of weighted equations follows from."""
    x2, u, slope, _ = weigher(field)
    information = field.information
    return {
        "u": float(information @ u),
        "ψ²": float(information @ (u**2 * x2)),
        "ψ'": float(information @ (u + 2 / field.components * slope * x2)),
    }


def _compute_score_factors(field, weigher):
    x2, u, slope, residual = weigher(field)
    # ∂(uΔ)/∂Δ is u across Δ and u + 2u'X² along it: their mean over the components.
    return residual, u, u + 2 / field.components * slope * x2


def _summarise_weights(field, weigher):
    _, u, _, residual = weigher(field)
    source_labels = field.name if field.name is not None else np.arange(len(field))
    candidates = np.argpartition(u, min(5, len(u) - 1))[:5]
    least_weighted = candidates[np.argsort(u[candidates], kind="stable")]
    return {
        "u": float(u.sum()),
        "u²": float(u @ u),
        "chi2": float(sum(field[rows].inner(*2 * [residual[:, rows]]).sum() for rows in slice_blocks(len(field)))),
        "sources": len(field),
        "least": [(float(u[i]), one_line_text(source_labels[i])) for i in least_weighted],
        "most": [float(u.max())],
    }
