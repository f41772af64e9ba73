"""Fits without outliers, and with a noise that the errors of the catalogue leave out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtri

from fit.normal import NormalEquations, Template, normal_equations, solve
from fit.normal.sums import sandwich, weighted_sums
from fit.results.quality import CLIPPED, ErrorSource
from fit.results.solution import AboutSolution, Solution, with_errors
from vsh.field import Field, SourcesWithErrors
from vsh.io.parts import Parts, apply_step, as_parts, median
from vsh.modes import Modes, as_modes
from vsh.scalars import ScalarField, modes_for
from vsh.tools import arguments
from vsh.tools.arguments import positive
from vsh.tools.digits import format_with_error
from vsh.tools.errors import ConvergenceError
from vsh.tools.notes import CodedNote
from vsh.tools.printing import log_calls
from vsh.tools.types import BoolArray


@dataclass(frozen=True, eq=False, kw_only=True)
class ClippedFit(AboutSolution):
    """A fit to the sources that agree with it.

    Attributes
    ----------
    solution : Solution
        Solution of the sources kept.
    kept : (n,) bool array or None
        Which those are; None of a catalogue in parts, whose sources `select` chooses.
    n_rounds : int
        How many fits it took.
    limit : float
        The largest X that was kept.
    factor : float
        Factor on the errors for the selection by residuals, included in the solution's covariance.
    n_clipped : int
        How many sources were left out.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> clipped = clip(field, 1, threshold=6.0)
    >>> clipped.n_clipped, len(clipped.sources(field))
    (0, 500)
    """

    solution: Solution
    kept: BoolArray | None
    n_rounds: int
    limit: float
    factor: float = 1.0
    n_clipped: int = 0

    def select(self, field: Field) -> Field:
        """Select the sources of a `field` in the solution's frame that agree with the fit; a step for `Parts.map`."""
        return _select_within(field, partial(_compute_distances, solution=self.solution), self.limit)

    def sources(self, field: Field | Parts) -> Field | Parts:
        """The sources that were kept, of the `field` or the parts that were clipped; a note says how many were not."""
        selection = field.map(self.select) if isinstance(field, Parts) else field[self.kept]
        return selection.add_note(self.solution.notes[-1])


@log_calls("clipped")
@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts), threshold=arguments.positive, max_rounds=arguments.whole
)
def clip(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    kappa: float = 3.0,
    threshold: float | None = None,
    *,
    max_rounds: int = 100,
) -> ClippedFit:
    """Fit, leave out sources that are too far from the fit, and repeat until nothing changes.

    The distance is X = √(Δᵀ C⁻¹ Δ), with Δ the residual of a source and C its covariance. Every round looks at all
    sources again, so one left out may come back. For Gaussian errors, a limit of κ times the median leaves out a
    fraction 2^(−κ²) of good sources. For a scalar field the limit is the one that leaves out the same fraction (κ = 3:
    3.1 standard errors).

    Parameters
    ----------
    field : Field, ScalarField or Parts
        The sources. Parts are read four times per round, or twice with a threshold.
    modes : Modes, or the degree lmax
        What to fit.
    kappa : float
        Leave out X > κ · median(X)
    threshold : float, optional
        Leave out X > threshold instead.
    max_rounds : int
        Largest number of rounds.

    Raises
    ------
    ConvergenceError
        If the clipping oscillates, has not converged after `max_rounds`, or leaves too few sources.
    ParameterError
        If kappa or the threshold is not positive.

    Notes
    -----
    Lindegren et al. (2018, A&A 616, A2) and Klioner et al. (2021, A&A 649, A9) clip in this way. Sources that are
    selected in this way scatter less than their errors, and carry less information. Let q be half the square
    of the limit in σ. To correct this, covariances are multiplied by (1 − e^−q)/(1 − (1 + q) e^−q), and χ² is divided
    by 1 − q e^−q/(1 − e^−q). Both corrections hold for Gaussian errors that are right, or all wrong by one factor. The
    square root of the first is 1.006, 1.108 and 1.308 for κ = 3, 2 and 1.5; pulls are then within 5 % of 1.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> off = field.motion.copy()
    >>> off[:, 7] += 5000
    >>> clipped = clip(Field(lon, lat, off, field.sigma), 1, 5.0)
    >>> np.flatnonzero(~clipped.kept).tolist()
    [7]
    """
    modes = modes_for(field, modes)
    sky = as_parts(field, SourcesWithErrors)
    cutoff = positive("kappa", kappa) if threshold is None else threshold
    normal = normal_equations(field, modes)
    n_sources = n_kept = normal.n_sources
    components = modes.components
    # For Gaussian errors the median tells their scale, and so how many σ the limit is.
    q = (chdtri(components, 2.0 ** -(cutoff**2)) if threshold is None else cutoff**2) / 2
    limit_in_medians = (
        float(np.sqrt(chdtri(components, 2.0 ** -(kappa**2)) / chdtri(components, 0.5))) if threshold is None else 1.0
    )
    selection_hash, before, earlier_hashes = None, None, set()
    for rounds in range(1, max_rounds + 1):
        solution = solve(normal)
        measure = partial(_compute_distances, solution=solution)
        if sky.in_memory is not None:  # once a round, for the median and the choice alike
            measure = partial(_return_known_distances, distances=measure(sky.in_memory))
        limit = threshold or limit_in_medians * float(median(sky, measure, f"clip, round {rounds}"))
        tally = sky.sum(partial(_summarise_kept, measure=measure, limit=limit), roles=(), words=f"clip, round {rounds}")
        if tally["mark"] == selection_hash or (selection_hash is None and tally["sources"] == n_sources):
            rule_text = (
                f"κ = {kappa:g}{'' if components == 2 else f', {limit_in_medians:.3g}'} times the median"
                if threshold is None
                else "the given threshold"
            )
            bound_text = f"residuals X > {limit:.3g} standard errors ({rule_text}; {rounds} rounds)"
            note = CodedNote(f"clipped {n_sources - n_kept} of {n_sources} sources with {bound_text}", CLIPPED)
            is_kept = measure(sky.in_memory) <= limit if sky.in_memory is not None else None
            return _correct_clipping_bias(solution, is_kept, rounds, limit, q, note, n_sources - n_kept)
        if components * tally["sources"] < len(modes):
            raise ConvergenceError(
                f"clipping leaves {tally['sources']} of {n_sources} sources, too few for {len(modes)} "
                f"coefficients: take a larger {'kappa' if threshold is None else 'threshold'} than {cutoff:g}"
            )
        selection_hash, n_kept = tally["mark"], tally["sources"]
        if selection_hash in earlier_hashes or rounds == max_rounds:
            n_swinging = sky.sum(
                partial(_count_differing, criterion=(measure, limit), previous=before), roles=(), words="clip"
            )
        if selection_hash in earlier_hashes and n_swinging <= max(1, n_sources // 1000):
            return _fit_sources_kept_by_both(sky, modes, (measure, limit), before, rounds, n_swinging, q)
        if selection_hash in earlier_hashes:
            raise ConvergenceError(
                f"the clipping oscillates after {rounds} rounds: {n_swinging} sources are alternately clipped and kept "
                f"at X ≈ {limit:.3g}. Take another kappa, or the absolute threshold={limit * 1.02:.3g}"
            )
        earlier_hashes.add(selection_hash)
        before = measure, limit
        normal = normal_equations(apply_step(sky, partial(_select_within, measure=measure, limit=limit)), modes)
    raise ConvergenceError(
        f"the clip has not settled after {max_rounds} rounds: {n_swinging} sources more or less in the last"
    )


def _fit_sources_kept_by_both(sky, modes, criterion, previous, rounds, n_swinging, q):
    """The fit to what both choices keep between which a few sources swing."""
    compute_ratios = partial(_compute_larger_distance_ratio, criterion=criterion, previous=previous)
    select_kept = partial(_select_within, measure=compute_ratios, limit=1.0)
    mask = None if sky.in_memory is None else compute_ratios(sky.in_memory) <= 1.0
    normal = normal_equations(apply_step(sky, select_kept), modes)
    n_sources, n_kept = sky.sum(len), normal.n_sources
    limit = criterion[1]
    note = (
        f"clipped {n_sources - n_kept} of {n_sources} sources with X > {limit:.3g} ({rounds} rounds; {n_swinging} of "
        f"them {'was' if n_swinging == 1 else 'were'} alternately clipped and kept)"
    )
    return _correct_clipping_bias(solve(normal), mask, rounds, limit, q, CodedNote(note, CLIPPED), n_sources - n_kept)


def _compute_larger_distance_ratio(field, criterion, previous):
    """The larger of X over its limit by two fits."""
    return np.maximum(*(distances(field) / limit for distances, limit in (criterion, previous)))


def _correct_clipping_bias(solution, is_kept, rounds, limit, q, note, n_clipped):
    """The clipped solution, its errors and χ² corrected for the choice by residuals up to X²/2 = q."""
    variance, share = compute_truncation_factors(q, solution.modes.components)
    if variance > 1.001:
        note += f"; errors multiplied by {np.sqrt(variance):.3f} and χ² divided by {share:.3f} for that choice"
    solution = replace(
        solution, covariance=solution.covariance * variance, chi2=solution.chi2 / share, notes=(*solution.notes, note)
    )
    counts: Any = {"n_rounds": rounds, "n_clipped": n_clipped}
    return ClippedFit(solution=solution, kept=is_kept, limit=limit, factor=float(np.sqrt(variance)), **counts)


def _compute_distances(field, solution):
    """X of each source."""
    return np.sqrt(solution.residuals(field).chi2)


def _return_known_distances(field, distances):
    """X of the field in memory, which was computed before."""
    return distances


def _select_within(field, measure, limit):
    return field[measure(field) <= limit]


def _count_differing(field, criterion, previous):
    """Count the sources that one fit keeps and the other does not."""
    is_kept, was_kept = (distances(field) <= limit for distances, limit in (criterion, previous or criterion))
    return int((is_kept != was_kept).sum())


def _summarise_kept(field, measure, limit):
    """Count the sources that are kept, and a sum of hashes that tells one choice from another."""
    is_kept = measure(field) <= limit
    position_bits = np.stack([field.lon[is_kept], field.lat[is_kept]]).view(np.uint64)
    # The finaliser of SplitMix64 (Steele et al. 2014) mixes the bits of each source's place; sums are modulo 2⁶⁴.
    hashes = position_bits[0] ^ (position_bits[1] * np.uint64(0x9E3779B97F4A7C15))
    for shift, multiplier in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        hashes = (hashes ^ (hashes >> np.uint64(shift))) * np.uint64(multiplier)
    return {
        "sources": int(is_kept.sum()),
        "mark": _HashSum(int(np.sum(hashes ^ (hashes >> np.uint64(31)), dtype=np.uint64))),
    }


class _HashSum(int):
    """A sum of hashes, modulo 2⁶⁴."""

    def __add__(self, other):
        return _HashSum(int.__add__(self, other) % 2**64)


def compute_truncation_factors(q: float, components: int = 2) -> tuple[float, float]:
    """Effect of a cut at X²/2 = q on Gaussian residuals: factors on variance and on χ²."""
    # For two, 1 − e^{−q} and 1 − (1 + q) e^{−q}.
    kept_fraction, kept_chi2_fraction = chdtr(components, 2 * q), chdtr(components + 2, 2 * q)
    return float(kept_fraction / kept_chi2_fraction), float(kept_chi2_fraction / kept_fraction)


@dataclass(frozen=True, eq=False, kw_only=True)
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
            As for `ReweightedFit.equations`.
        """
        noisy_sky = apply_step(field, EnlargedErrors(self.excess_noise**2, self.scale**2))
        return normal_equations(noisy_sky, as_modes(modes, type(self.solution.modes)), templates=templates)


@log_calls("excess noise")
@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts), tolerance=arguments.positive, max_rounds=arguments.whole
)
def excess_noise(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    *,
    scale: bool = False,
    tolerance: float = 1e-4,
    max_rounds: int = 100,
) -> ExcessNoise:
    """Fit with C + s² I for every source's covariance, s by restricted maximum likelihood.

    Parameters
    ----------
    field : Field, ScalarField or Parts
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
    modes, sky = modes_for(field, modes), as_parts(field, SourcesWithErrors)
    likelihood = _RestrictedLikelihood(sky, modes, bool(scale))
    parameters = likelihood.find_likeliest_parameters(max_rounds, tolerance)
    _, gradient = likelihood.compute_loss_and_gradient(parameters)
    errors = likelihood.compute_parameter_errors(parameters)
    is_positive = parameters > 0
    steps_in_errors = gradient * likelihood.n_sources * errors  # to the maximum, in errors
    if np.any(np.abs(steps_in_errors[is_positive]) > 0.05) or np.any(steps_in_errors[~is_positive] < -0.05):
        if scale and parameters[0] > 100:
            raise ConvergenceError(
                f"beside an excess noise {np.sqrt(parameters[0]):.3g} times as large as the errors no factor on them "
                "can be told: fit without one (scale=False, --method excess-noise)"
            )
        distance_text = ", ".join(f"{step:+.2g}" for step in steps_in_errors)
        raise ConvergenceError(
            f"the excess noise has not settled after {likelihood.n_rounds} fits: it is {distance_text} of its errors "
            f"from the maximum of the likelihood; allow more than max_rounds={max_rounds}"
        )
    unit = likelihood.unit
    noisy_sky = sky.map(likelihood.make_error_model(parameters))
    solution = solve(likelihood.compute_likelihood_sums(parameters)["normal"])
    covariance, dof = sandwich(noisy_sky, partial(_compute_unit_score_factors, solution=solution), modes)
    noise = unit * np.sqrt(parameters[0])
    # From the variance s² to s; at the boundary s = 0 the error is the s at one error of s².
    noise_error = unit**2 * errors[0] / (2 * noise) if parameters[0] > errors[0] / 4 else unit * np.sqrt(errors[0])
    scale_factor = float(np.sqrt(parameters[1])) if scale else 1.0
    scale_factor_error = float(errors[1] / (2 * scale_factor)) if scale else 0.0
    noise_text = f"{format_with_error(noise, noise_error)} {solution.unit}".rstrip()
    note = f"excess noise: {noise_text} added in quadrature to every component"
    if scale:
        note += f", after scaling the errors by {format_with_error(scale_factor, scale_factor_error)}"
    errors_from, notes = "the residuals, source by source, with excess noise", (*solution.notes, note)
    solution = with_errors(solution, covariance, errors_from, ErrorSource.EXCESS_NOISE, dof, notes=notes)
    return ExcessNoise(
        solution=solution,
        excess_noise=float(noise),
        excess_noise_error=float(noise_error),
        scale=scale_factor,
        scale_error=scale_factor_error,
        n_rounds=likelihood.n_rounds,
    )


def _compute_unit_score_factors(field, solution):
    unit_weights = np.ones(len(field))
    return solution.residuals(field).data, unit_weights, unit_weights


@dataclass(frozen=True)
class EnlargedErrors:
    """A step: the field with errors f² C + s² I."""

    noise_variance: float
    factor_squared: float

    def __call__(self, field):
        sigma = np.sqrt(self.factor_squared * field.sigma**2 + self.noise_variance)
        if isinstance(field, ScalarField):
            return field.with_errors(sigma)
        return field.with_errors(sigma, self.factor_squared * field.rho * np.prod(field.sigma, 0) / np.prod(sigma, 0))


def _count_and_sum_weights(field):
    return len(field), float(field.information.sum())


def _sum_likelihood_terms(field, error_model, modes):
    """All that the likelihood needs of some sources."""
    field = error_model(field)
    k, weights = field.components, field.weights
    # 1 − s² W, the share of the catalogue's own errors: from sums of W it would be lost to rounding where s is large.
    identity, multiplicity = (np.array([[1.0], [1.0], [0.0]]), [1, 1, 2]) if k == 2 else (np.ones((1, 1)), [1])
    own_shares = identity - error_model.noise_variance * weights
    squared_weights = weights**2
    if k == 2:
        a, b, c = weights
        squared_weights = np.stack([a * a + c * c, b * b + c * c, c * (a + b)])
    # C⁻¹ ∂C: W for s², (1 − s² W)/f² for f². Their products' traces are the expected information.
    return {
        "normal": normal_equations(field, modes),
        "squared": weighted_sums(field, squared_weights, modes),
        "logdet": float(field.log_determinants.sum()),
        "trace": float(weights[:k].sum()),
        "trace of squares": float(squared_weights[:k].sum()),
        "cross": float(np.sum(multiplicity @ (weights * own_shares))),
        "own": float(np.sum(multiplicity @ own_shares**2)),
    }


class _RestrictedLikelihood:
    """−ln of the restricted likelihood a source, of s² (in units of the mean variance by weight) and f²."""

    def __init__(self, sky, modes, has_scale):
        self.sky, self.modes, self.has_scale = sky, modes, has_scale
        self.n_sources, information = sky.sum(_count_and_sum_weights, roles=(), words="excess noise")
        self.unit = float(np.sqrt(modes.components * self.n_sources / information))
        self.n_rounds = 0
        self.cached_sums: tuple[Any, Any] = (None, None)

    def make_error_model(self, parameters):
        """The step to the field with errors f² C + s² I."""
        return EnlargedErrors(float(parameters[0]) * self.unit**2, float(parameters[1]) if self.has_scale else 1.0)

    def compute_likelihood_sums(self, parameters):
        """Sums over all sources, cached."""
        key = tuple(map(float, parameters))
        if key != self.cached_sums[0]:
            self.n_rounds += 1
            sum_terms = partial(_sum_likelihood_terms, error_model=self.make_error_model(parameters), modes=self.modes)
            self.cached_sums = key, self.sky.sum(sum_terms, roles=(), words=f"excess noise, trial {self.n_rounds}")
        return self.cached_sums[1]

    def compute_loss_and_gradient(self, parameters):
        """Value and gradient."""
        sums = self.compute_likelihood_sums(parameters)
        normal, n = sums["normal"], self.n_sources
        solution = solve(normal)
        values = solution.values
        loss = (sums["logdet"] + solution.chi2 + np.linalg.slogdet(normal.matrix)[1]) / 2
        # With W = C⁻¹ and ∂C/∂s² = I: ½ [tr W − |Wr|² − tr(N⁻¹ Σ AᵀW²A)], r = y − A c.
        matrix, rhs, weighted_residual_square = sums["squared"]
        residual_square = weighted_residual_square - 2 * values @ rhs + values @ matrix @ values
        by_noise = (sums["trace"] - residual_square - float(np.sum(solution.covariance * matrix))) / 2
        gradient = [by_noise * self.unit**2]
        if self.has_scale:  # ∂C/∂f² = (C − s² I)/f²
            noise = parameters[0] * self.unit**2
            gradient.append(
                ((self.modes.components * n - solution.chi2 - len(self.modes)) / 2 - noise * by_noise) / parameters[1]
            )
        return loss / n, np.array(gradient) / n

    def find_likeliest_parameters(self, max_rounds, tolerance):
        """The parameters of the largest likelihood, searched along ln(1 + s²) and ln f²."""
        start = np.array([np.log1p(max(self.estimate_excess_variance(), 1e-2)), 0.0][: 1 + self.has_scale])
        bounds = [(0.0, None), (np.log(1e-6), None)][: len(start)]

        def to_parameters(log_parameters):
            return np.r_[np.expm1(log_parameters[0]), np.exp(log_parameters[1:])]

        def loss(log_parameters):
            loss, gradient = self.compute_loss_and_gradient(to_parameters(log_parameters))
            return loss, gradient * np.r_[np.exp(log_parameters[0]), np.exp(log_parameters[1:])]

        from scipy.optimize import minimize  # slow to import

        options = {"maxiter": max_rounds, "ftol": 1e-15, "gtol": tolerance / np.sqrt(self.n_sources)}
        parameters = to_parameters(minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options).x)
        for _ in range(40):  # along a ridge, where one of the two hides the other, by Fisher's scoring
            loss, gradient = self.compute_loss_and_gradient(parameters)
            step = -np.linalg.pinv(self.compute_expected_information(parameters)) @ gradient * self.n_sources
            errors = self.compute_parameter_errors(parameters)
            if not np.isfinite(errors).all():
                break
            if self.n_rounds >= max_rounds or np.all(np.abs(step) < 0.01 * errors) or parameters[0] == 0:
                break
            lower_limits = np.array([0.0, 1e-6])[: len(step)]
            for fraction in (1.0, 0.5, 0.25, 0.1, 0.03):
                trial = np.maximum(parameters + fraction * np.clip(step, -2 * errors, 2 * errors), lower_limits)
                if self.compute_loss_and_gradient(trial)[0] <= loss:
                    break
            parameters = trial
        return parameters

    def estimate_excess_variance(self):
        """s² by which χ² of the plain fit would be as expected, about, in units of the mean variance."""
        solution = solve(self.compute_likelihood_sums(np.array([0.0, 1.0]))["normal"])
        return solution.chi2 / max(solution.dof, 1) - 1

    def compute_parameter_errors(self, parameters):
        """Standard errors from the expected information of as many sources as the coefficients leave."""
        return np.sqrt(np.diag(np.linalg.pinv(self.compute_expected_information(parameters))))

    def compute_expected_information(self, parameters):
        """The expected information of the parameters."""
        sums, n = self.compute_likelihood_sums(parameters), self.n_sources
        information = np.array([[self.unit**4 * sums["trace of squares"]]])
        if self.has_scale:
            cross_information = self.unit**2 * sums["cross"] / parameters[1]
            scale_information = sums["own"] / parameters[1] ** 2
            information = np.array([[information[0, 0], cross_information], [cross_information, scale_information]])
        remaining_share = max(1 - len(self.modes) / (self.modes.components * n), 1e-3)
        return information / 2 * remaining_share
