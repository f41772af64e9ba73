"""The fit to quote, and the other estimators by name: what commands, classes and templates fit with.

`recommended` is Student's t, to a degree that the sources bear, with the systematic floor in the errors; `METHODS` has
all others.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fit.background import Floor, equations_of, floor
from fit.normal import NormalEquations, Template, add_coverage_notes, fit_field, normal_equations, solve
from fit.resample import bootstrap, compare_blocks, jackknife
from fit.results.quality import ERRORS_TOO_SMALL
from fit.results.solution import AboutSolution, Solution
from fit.robust import ExcessNoise, ReweightedFit, TailsError, clip, excess_noise, student_t
from vsh.field import Field, SourcesWithErrors
from vsh.io.catalogue import as_field
from vsh.io.parts import Parts, apply_step, as_parts, median, sample_of
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.arguments import choice
from vsh.tools.errors import ConvergenceError, DegeneracyError, ParameterError, VshError
from vsh.tools.notes import CodedNote, codes_of
from vsh.tools.types import FloatArray, Rng

__all__ = ["METHODS", "Estimate", "Recommended", "estimate", "recommended"]


#: A fit to degree L needs so many sources for each of its L (L + 2) pairs of unknowns, two numbers each. With half as
#: many a fit with free tails may go exactly through the most precise sources, and a floor cannot be told from noise.
_SOURCES_PER_PAIR = 8
#: Degree 1 alone needs half of that: no floor and no degree is told from another there.
_FEWEST = 12
#: The degree unless another is named: the spectrum of the systematic errors is seen best from 5 on.
_DEGREE = 5
#: Where many errors are too small, Student's t is tried with the Gaussian excess noise, which outliers enlarge; it is
#: halved so often at most. A fit that goes exactly through a few precise sources gains p ln 2 in ln L by each halving,
#: one number for each of its p coefficients: less than this beyond it is no reason.
_MAX_HALVINGS, _LEAST_GAIN = 8, 6.0
#: It is estimated without motions of so many times their median.
_LARGEST_MOTION = 10.0
#: Catalogues in which the errors make fewer sources count, by (Σw)²/Σw², are always fitted with such a noise: a few
#: sources with much smaller errors than the others would determine the fit, and nothing could contradict them.
_FEWEST_EFFECTIVE = 64
#: Sources of which more have the noise that a sample tells, and are fitted to this part of their errors. Where ν of a
#: sample is below the last, that of all is below 1.3.
_MANY_SOURCES, _LOOSE_TOLERANCE, _LEAST_SAMPLE_NU = 100_000, 1e-3, 1.2
#: Rounds that are allowed for each.
_ROUNDS = 100
#: From this degree on the floor is estimated.
_LEAST_FLOOR_DEGREE = 3


class WeightedFit(AboutSolution):
    """A fit whose weights sum other equations, too: of classes, of other degrees, with templates."""

    weights: ReweightedFit | ExcessNoise | None

    def equations(
        self, field: Field | Parts, modes: Modes | int, *, templates: Sequence[Template] = ()
    ) -> NormalEquations:
        """Sum normal equations of some of the sources, a class say, by the weights of this fit.

        Parameters
        ----------
        field, modes, templates
            As for `fit.robust.ReweightedFit.equations`.
        """
        if self.weights is None:
            return normal_equations(field, modes, templates=templates)
        return self.weights.equations(field, modes, templates=templates)


@dataclass(frozen=True, eq=False)
class Recommended(WeightedFit):
    """The recommended fit.

    Attributes
    ----------
    solution : Solution
        With the floor in its errors, where there is one.
    plain : Solution
        The robust fit without it.
    weights : ReweightedFit or None
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
    weights: ReweightedFit | None

    @property
    def floor(self) -> Floor | None:
        """The systematic floor in the errors; None where the sources do not determine one."""
        return self.solution.floor


def degree_for(n_sources: int, most: int, least: int = 1, per_mode: int = _SOURCES_PER_PAIR) -> int:
    """Find the highest degree up to `most` that so many sources bear.

    Parameters
    ----------
    n_sources : int
        How many there are.
    most, least : int
        The highest degree wanted, and the lowest that is of use.
    per_mode : int
        Sources that each pair of unknowns needs: half as many where tails are not free, as in classes of one fit.

    Raises
    ------
    DegeneracyError
        If they do not bear the lowest.
    """
    lmax = next((l for l in range(most, 1, -1) if n_sources >= per_mode * l * (l + 2)), int(n_sources >= _FEWEST))
    if lmax < least:
        raise DegeneracyError(f"{n_sources} sources do not bear degree {least}")
    return lmax


@arguments.accepts(field=as_field)
def recommended(field: Any, lmax: int | None = None) -> Recommended:
    """Fit a catalogue as recommended: robustly, and with the systematic floor in the errors of spin and acceleration.

    Parameters
    ----------
    field : Field, ScalarField, Parts, path or table
        The sources; a path or a table is read by `vsh.read_field`. Of a scalar field, parallaxes say, the result is the
        mean and the dipole.
    lmax : int, optional
        The highest degree; 5 unless given. It is lowered, with a note, if there are too few sources, or if they cover
        too little of the sky to separate the modes. Below degree 3 there is no floor.

    Raises
    ------
    DegeneracyError
        If the sources do not determine spin and acceleration.

    Notes
    -----
    If many quoted errors are several times too small (ν of Student's t below 1.3), or few sources have most of the
    weight, (Σw)²/Σw² up to 64, an excess noise is added in quadrature to all of them: without it the fit could go
    exactly through a few precise sources. On 200 clean simulated skies the fit is as precise as least squares with a
    floor. The coverage on simulated skies, including those with wrong errors, outliers, systematic errors and 15 to 200
    sources, is in docs/validation.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> result = recommended(Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0)))
    >>> result.solution.modes.lmax, result.floor is not None
    (5, True)
    """
    count, weight_sum, square_sum = as_parts(field, SourcesWithErrors).sum(_sum_weight_moments, roles=())
    n_sources = int(count)
    max_degree = _DEGREE if lmax is None else arguments.whole("lmax", lmax)
    degree, reason = degree_for(max(n_sources, _FEWEST), max_degree), f"{n_sources} sources do not bear more"
    while True:
        try:
            weights, solution = _fit_robustly(field, degree, n_sources, weight_sum**2 > _FEWEST_EFFECTIVE * square_sum)
            break
        except DegeneracyError:
            if degree == 1:
                raise
            degree, reason = degree - 1, f"the {n_sources} sources see too little of the sky for more"
    if degree < max_degree:
        note = f"fitted to degree {degree} instead of {max_degree}: {reason}"
        solution = replace(solution, notes=(*solution.notes, note))
    plain = add_coverage_notes(solution, field)
    systematic_floor = _estimate_floor(plain)
    if systematic_floor is None:
        return Recommended(replace(plain, is_recommended=True), plain, weights)
    solution = solve(equations_of(plain, scalars=True), floor=systematic_floor)
    formal_covariance = plain.covariance if plain.formal_covariance is None else plain.formal_covariance
    return Recommended(replace(solution, formal_covariance=formal_covariance, is_recommended=True), plain, weights)


def _fit_robustly(field, degree, n_sources, is_weight_shared):
    """Student's t, with an excess noise where the quoted errors need one; least squares where no weights settle.

    `is_weight_shared` tells that many sources share the weight: only then may a fit without a noise stand.
    """
    fits: list[ReweightedFit] = []
    reason, tolerance = "", 1e-4 if n_sources <= _MANY_SOURCES else _LOOSE_TOLERANCE
    try:
        if is_weight_shared:
            noiseless_fit = student_t(field, degree, tolerance=tolerance, least_nu=_LEAST_SAMPLE_NU)
            if ERRORS_TOO_SMALL not in codes_of(noiseless_fit.solution.notes):
                return noiseless_fit, noiseless_fit.solution
        # Its likelihood is not compared with those below: where errors say little of the scatter, a fit without noise
        # goes through the most precise sources, there it is the likelier the smaller their errors are.
    except (ConvergenceError, TailsError) as error:
        reason = str(error)
    with suppress(ConvergenceError, DegeneracyError):
        if n_sources <= _MANY_SOURCES:
            fits = _fit_halving_noise(field, degree)
        else:  # which noise it is, a sample tells
            sample_fits = _fit_halving_noise(
                sample_of(as_parts(field, SourcesWithErrors), _MANY_SOURCES // 5, n_sources), min(degree, _DEGREE)
            )
            noises = [sample_fit.noise for sample_fit in sample_fits[-1:]]
            fits = [student_t(field, degree, tolerance=tolerance, max_rounds=_ROUNDS, noise=noise) for noise in noises]
    if not fits:
        solution = fit_field(field, degree).scaled
        note = f"warning: least squares in place of Student's t ({reason or 'no fit with an excess noise settled'})"
        return None, replace(solution, notes=(*solution.notes, note))
    last_fit = fits[-1]
    solution = last_fit.solution
    if last_fit.noise:
        noise_size = f"{last_fit.noise:.4g} {solution.unit}".rstrip()
        text = f"an excess noise of {noise_size}, by the residuals, was added in quadrature to every error"
        note = CodedNote(text, ERRORS_TOO_SMALL)
        solution = replace(solution, notes=(*solution.notes, note))
    return last_fit, solution


def _fit_halving_noise(field, degree):
    """Fits with an excess noise, halved while that makes them likelier by more than it must; the last is the best."""
    fits: list[ReweightedFit] = []
    motion_limit = _LARGEST_MOTION * median(as_parts(field, SourcesWithErrors), _compute_motion_sizes, "noise")
    noise = excess_noise(apply_step(field, partial(_select_small_motions, limit=motion_limit)), degree).excess_noise
    for _ in range(_MAX_HALVINGS):
        with suppress(ConvergenceError, DegeneracyError):
            refit = student_t(field, degree, noise=noise, max_rounds=_ROUNDS)
            least_gain = _LEAST_GAIN + len(refit.solution.modes) * np.log(2)
            if not fits or refit.log_likelihood >= fits[-1].log_likelihood + least_gain:
                fits.append(refit)
                noise /= 2
                continue
        break
    return fits


def _compute_motion_sizes(field):
    """Compute the size of each motion, or number."""
    return np.linalg.norm(field.data, axis=0)


def _select_small_motions(field, limit):
    """Select the sources whose motion is not larger than a limit."""
    return field[_compute_motion_sizes(field) <= limit]


def _sum_weight_moments(field):
    """Sum the number of the sources, their weights, and the squares of these."""
    weights = field.information
    return np.array([len(field), weights.sum(), weights @ weights])


def _estimate_floor(solution):
    """Estimate the systematic floor; None where the solution determines none."""
    if solution.modes.lmax < _LEAST_FLOOR_DEGREE:
        return None
    try:
        systematic_floor = floor(solution)
    except VshError:
        return None
    return systematic_floor if np.isfinite(list(systematic_floor.powers.values())).all() else None


#: The degree of every estimator but the recommended one, which chooses its own.
DEGREE = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate(WeightedFit):
    """A fit by one of `METHODS`.

    Attributes
    ----------
    solution : Solution
        With the errors of this estimator.
    method : str
        Its name.
    sources : Field or Parts
        Those that were fitted.
    plain : Solution
        The same without a systematic floor in its errors.
    n_clipped : int
        How many sources were clipped.
    weights : ReweightedFit, ExcessNoise or None
        The fit whose weights classes and templates are summed with; None of least squares.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> estimate(field, 3, "student").solution.modes.lmax
    3
    """

    solution: Solution
    method: str
    sources: Field | Parts
    plain: Solution
    n_clipped: int = 0
    weights: ReweightedFit | ExcessNoise | None = None

    @property
    def floor(self) -> Floor | None:
        """The systematic floor that is in the errors, or None."""
        return self.solution.floor

    @property
    def is_scaled(self) -> bool:
        """Return whether χ² scales the errors of `equations`: not where they come from residuals already."""
        return not isinstance(self.weights, ReweightedFit)

    @property
    def source_weights(self) -> FloatArray | None:
        """Factor on each source's inverse covariance, (n,); None of least squares and of parts."""
        return self.weights.weights if isinstance(self.weights, ReweightedFit) else None

    @property
    def class_note(self) -> str:
        """Note on the estimator of classes and templates."""
        if not self.is_scaled:
            return "classes and templates are summed by the weights of the robust fit, errors from their own residuals"
        if isinstance(self.weights, ExcessNoise):
            return "classes and templates have the excess noise of the whole, errors scaled by the χ²/dof of each"
        return "classes and templates are fitted by least squares, errors scaled by the χ²/dof of each"


def _run_recommended(field, lmax, value, rng):
    fit = recommended(field, lmax)
    return Estimate(solution=fit.solution, method="recommended", sources=field, plain=fit.plain, weights=fit.weights)


def _run_least_squares(field, lmax, value, rng):
    solution = solve(normal_equations(field, lmax)) if isinstance(field, Parts) else fit_field(field, lmax)
    return _make_estimate("least-squares", solution, field)


def _run_clip(field, lmax, value, rng):
    clipped_fit = clip(field, lmax, 3.0 if value is None else float(value))
    return _make_estimate("clip", clipped_fit.solution, clipped_fit.sources(field), clipped_fit.n_clipped)


def _run_student(field, lmax, value, rng):
    robust_fit = student_t(field, lmax)
    return _make_estimate("student", _drop_unsure_errors(robust_fit), field, 0, robust_fit)


#: Degrees of freedom that the scores of a robust fit must have for its errors to be those of the sources; and with many
#: quoted errors that are too small. With tails, of which ν is below the last number, each coefficient needs one.
_SURE_DOF, _DOUBTFUL_DOF, _TAILS_NU = 7, 100, 10


def _drop_unsure_errors(robust_fit):
    """Return a fit without errors where a few sources decide it: nothing could contradict them."""
    solution = robust_fit.solution
    min_dof = max(_SURE_DOF, len(solution.modes)) if robust_fit.nu < _TAILS_NU else _SURE_DOF
    if solution.covariance_dof >= (_DOUBTFUL_DOF if ERRORS_TOO_SMALL in codes_of(solution.notes) else min_dof):
        return solution
    warning = "warning: few sources decide this fit, and it has no errors: fit.recommended adds a noise to those quoted"
    return replace(
        solution, covariance_dof=0.0, block_dof=(), notes=(*solution.notes, CodedNote(warning, ERRORS_TOO_SMALL))
    )


def _run_excess_noise(field, lmax, value, rng):
    noise_fit = excess_noise(field, lmax, scale=choice("excess-noise", value, (None, "scale")) == "scale")
    return _make_estimate("excess-noise", noise_fit.solution, field, 0, noise_fit)


def _run_bootstrap(field, lmax, value, rng):
    resampled = bootstrap(field, lmax, 100 if value is None else int(value), rng)
    return _make_estimate("bootstrap", resampled.resampled_solution, field)


def _run_jackknife(field, lmax, value, rng):
    if value is not None:
        return _make_estimate("jackknife", jackknife(field, lmax, int(value)).resampled_solution, field)
    _, best_blocks, advice = compare_blocks(field, lmax)
    solution = best_blocks.resampled.resampled_solution
    return _make_estimate("jackknife", replace(solution, notes=(*solution.notes, advice)), field)


def _make_estimate(method, solution, sources, n_clipped=0, weights=None):
    """Make an estimate whose errors are those of the solution; of the catalogue's, scaled where χ² contradicts them."""
    solution = add_coverage_notes(solution, sources)
    return Estimate(
        solution=solution.scaled, method=method, sources=sources, plain=solution, n_clipped=n_clipped, weights=weights
    )


#: The estimators by name. Each takes a field (or parts), a degree, a value or None, and a source of randomness, and
#: gives an `Estimate`. The value is κ of the clipping, "scale" of the excess noise (a factor on the errors as well),
#: the number of bootstrap replicates, the NSIDE of the jackknife's blocks.
METHODS: dict[str, Callable[[Any, Any, Any, Rng], Estimate]] = {
    "recommended": _run_recommended,
    "least-squares": _run_least_squares,
    "clip": _run_clip,
    "student": _run_student,
    "excess-noise": _run_excess_noise,
    "bootstrap": _run_bootstrap,
    "jackknife": _run_jackknife,
}
#: Those that take a value.
WITH_VALUE = ("clip", "excess-noise", "bootstrap", "jackknife")


@arguments.accepts(field=as_field, rng=arguments.seed)
def estimate(
    field: Any,
    lmax: Modes | int | None = None,
    method: str = "recommended",
    value: float | str | None = None,
    *,
    rng: Rng = 1,
) -> Estimate:
    """Fit a field by one of the estimators of `METHODS`.

    Parameters
    ----------
    field : Field, Parts, path or table
        The sources; a path or a table is read by `vsh.read_field`.
    lmax : Modes or int, optional
        The highest degree; 3 unless given, and 5 of the recommended fit.
    method : str
        A name in `METHODS`.
    value : float or str, optional
        κ of "clip" (3), the number of replicates of "bootstrap" (100), the NSIDE of "jackknife" (several are compared
        unless given), "scale" of "excess-noise".
    rng : Generator or int
        The source of all randomness.

    Raises
    ------
    ParameterError
        If there is no such method, or it takes no value.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> print(estimate(field, 1, "least-squares").answer.lines[0][1].partition(";")[0])
    least squares, formal errors, to degree 1
    """
    choice("method", method, tuple(METHODS))
    if value is not None and method not in WITH_VALUE:
        raise ParameterError(f"the method {method} takes no value, and {value!r} was given")
    if method == "recommended" and isinstance(lmax, Modes):
        lmax = lmax.lmax
    degree = lmax if lmax is not None or method == "recommended" else DEGREE
    return METHODS[method](field, degree, value, rng)
