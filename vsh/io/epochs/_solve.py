"""Five astrometric parameters, or six, from positions along scan, source by source, robustly as AGIS does it.

Lindegren et al. (2012, A&A 538, A78), sect. 3.6 and 5.1.2: a position at time t under the position angle ψ is

    w = (Δα* + µ_α* t) sin ψ + (Δδ + µ_δ t) cos ψ + f_ϖ ϖ − f_ν Δν,

with Δν, where a colour factor f_ν is given, the correction of the effective wavenumber: a pseudocolour. Observations
far from the fit have less weight, and what scatter is left is an excess noise of the source. The two depend on each
other and are found in turn.
"""

from dataclasses import dataclass, replace

import numpy as np

from vsh.tools.notebook import Frozen
from vsh.tools.types import BoolArray, FloatArray, IntArray

#: The cubic between two and three σ that joins 1 to e^{−z/3} with its slope (eq. 66 there).
_QUADRATIC, _CUBIC = 3 - 10 / 3 * np.exp(-1.0), 2 - 7 / 3 * np.exp(-1.0)
#: How well the effective wavenumber of a source is known a priori in the six-parameter solutions of DR4, as ESA's
#: gaiasupdate has it. [µm⁻¹]
COLOUR_PRIOR = 0.085
#: Observations with less weight do not count among the degrees of freedom.
_OUTLIER = 0.2
#: Rounds of weights and excess noise, and steps of the excess noise alone at the end; to which of itself it settles.
_ROUNDS, _STEPS, _TOLERANCE = 30, 10, 1e-6


@dataclass(frozen=True, eq=False)
class FiveParameters(Frozen):
    """Solutions of n sources.

    Attributes
    ----------
    values : (n, 5) array
        Δα*, Δδ, ϖ, µ_α*, µ_δ, in the unit of the observations, and that a year. nan where there is no solution.
    covariance : (n, 5, 5) array
        Formal, with weights and excess noise.
    excess_noise : (n,) array
        Excess noise of each source.
    observations, outliers : (n,) int arrays
        How many there were, and how many of them have a weight below 0.2.
    weights : (k,) array
        Weights of the observations.
    pseudocolour, pseudocolour_error : (n,) arrays or None
        Correction of the effective wavenumber, with its prior, and its error. [µm⁻¹]
    """

    values: FloatArray
    covariance: FloatArray
    excess_noise: FloatArray
    observations: IntArray
    outliers: IntArray
    weights: FloatArray
    pseudocolour: FloatArray | None = None
    pseudocolour_error: FloatArray | None = None

    @property
    def solved(self) -> BoolArray:
        """Mask of the sources with a solution, (n,)."""
        return np.isfinite(self.values[:, 0])


def make_design_rows(angle: FloatArray, parallax_factor: FloatArray, time: FloatArray) -> FloatArray:
    """∂w by Δα*, Δδ, ϖ, µ_α*, µ_δ, (5, k)."""
    sin, cos = np.sin(angle), np.cos(angle)
    return np.stack([sin, cos, parallax_factor, time * sin, time * cos])


def downweighting_factor(z: FloatArray) -> FloatArray:
    """The weight of an observation at z standard deviations: 1 up to 2, a cubic to 3, e^{−z/3} beyond."""
    z = np.abs(z)
    cubic = 1 - _QUADRATIC * (z - 2) ** 2 + _CUBIC * (z - 2) ** 3
    return np.where(z <= 2, 1.0, np.where(z < 3, cubic, np.exp(-z / 3)))


def solve_epochs(
    source: IntArray,
    design: FloatArray,
    position: FloatArray,
    error: FloatArray,
    *,
    colour: FloatArray | None = None,
    robust: bool = True,
) -> FiveParameters:
    """Solve for the five parameters of every source, and a pseudocolour where there are colour factors.

    Parameters
    ----------
    source : (k,) int array
        Source of each observation, from 0, rising.
    design : (5, k) array
        Columns from `make_design_rows`.
    position, error : (k,) arrays
        Along scan, and its standard error.
    colour : (k,) array, optional
        The colour factor, −∂w/∂ν: a correction of the effective wavenumber is then a sixth parameter, known to be
        within `COLOUR_PRIOR` of zero as in DR4. [unit of the observations × µm]
    robust : bool
        Weights and excess noise as AGIS has them; plain least squares otherwise.
    """
    n_sources = int(source[-1]) + 1 if len(source) else 0
    design_terms = design if colour is None else np.vstack([design, -np.asarray(colour, float)])
    sources = _LeastSquares(source, n_sources, design_terms, position, error)
    is_solvable = sources.find_solvable_sources()
    weights, variances = np.ones(len(source)), np.zeros(n_sources)
    if robust:
        weights, variances = _find_weights_and_variances(sources, is_solvable)
    values, inverse = sources.solve(weights, variances, is_solvable)
    outliers = sources.sum_per_source((weights < _OUTLIER).astype(float)).astype(int)
    solution = FiveParameters(values[:, :5], inverse[:, :5, :5], np.sqrt(variances), sources.counts, outliers, weights)
    if colour is None:
        return solution
    return replace(solution, pseudocolour=values[:, 5], pseudocolour_error=np.sqrt(inverse[:, 5, 5]))


class _LeastSquares:
    """Observations of many sources, and least squares of each with any weights."""

    def __init__(self, source, n_sources, design, position, error):
        self.source, self.n_sources, self.design, self.position = source, n_sources, design, position
        self.variance = np.asarray(error, float) ** 2
        self.counts = np.bincount(source, minlength=n_sources)
        self.n_terms = len(design)

    def sum_per_source(self, values):
        return np.bincount(self.source, values, self.n_sources)

    def compute_normal_equations(self, weights, excess_variance):
        """Compute the normal matrices, (n, 5, 5), and right-hand sides, (n, 5)."""
        inverse_variance = weights / (self.variance + excess_variance[self.source])
        matrix, rhs = np.empty((self.n_sources, self.n_terms, self.n_terms)), np.empty((self.n_sources, self.n_terms))
        for i in range(self.n_terms):
            weighted_row = inverse_variance * self.design[i]
            rhs[:, i] = self.sum_per_source(weighted_row * self.position)
            for j in range(i + 1):
                matrix[:, i, j] = matrix[:, j, i] = self.sum_per_source(weighted_row * self.design[j])
        if self.n_terms > 5:
            matrix[:, 5, 5] += 1 / COLOUR_PRIOR**2
        return matrix, rhs

    def find_solvable_sources(self):
        """Find which sources have more observations than parameters, and scans in several directions and times."""
        matrix = self.compute_normal_equations(np.ones(len(self.source)), np.zeros(self.n_sources))[0][:, :5, :5]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", matrix), 1e-300))
        scaled_matrix = matrix / (scale[:, :, None] * scale[:, None])
        return (self.counts > self.n_terms) & (np.linalg.eigvalsh(scaled_matrix)[:, 0] > 1e-6)

    def solve(self, weights, excess_variance, is_solvable):
        """Solve for the parameters, (n, 5), and their covariance; nan where there is no solution."""
        matrix, rhs = self.compute_normal_equations(weights, excess_variance)
        parameters, covariances = np.full(rhs.shape, np.nan), np.full(matrix.shape, np.nan)
        covariances[is_solvable] = np.linalg.inv(matrix[is_solvable])
        parameters[is_solvable] = np.einsum("nij,nj->ni", covariances[is_solvable], rhs[is_solvable])
        return parameters, covariances

    def compute_residuals(self, weights, excess_variance, is_solvable):
        parameters, _ = self.solve(weights, excess_variance, is_solvable)
        return self.position - np.einsum("ki,ik->k", np.nan_to_num(parameters)[self.source], self.design)

    def sum_squares_and_slopes(self, weights, excess_variance, is_solvable):
        """Compute Σ w r²/(σ² + s²) of every source and its slope by s²."""
        inverse_variance = 1 / (self.variance + excess_variance[self.source])
        terms = weights * self.compute_residuals(weights, excess_variance, is_solvable) ** 2 * inverse_variance
        return self.sum_per_source(terms), -self.sum_per_source(terms * inverse_variance)

    def select_sources(self, is_selected):
        """Select some of the sources, numbered anew, and find which observations are theirs."""
        is_theirs = is_selected[self.source]
        number = np.cumsum(is_selected) - 1
        design, position, error = self.design[:, is_theirs], self.position[is_theirs], np.sqrt(self.variance[is_theirs])
        return _LeastSquares(number[self.source[is_theirs]], int(is_selected.sum()), design, position, error), is_theirs


def _find_weights_and_variances(sources, is_solvable):
    """Find the weights of the observations and the variances of the excess noise, in turn."""
    all_weights, all_variances = np.ones(len(sources.source)), np.zeros(sources.n_sources)
    squares, _ = sources.sum_squares_and_slopes(all_weights, all_variances, is_solvable)
    is_noisy = is_solvable & (squares > sources.counts - sources.n_terms)  # the others are as their errors say
    if not is_noisy.any():
        return all_weights, all_variances
    subset, is_theirs = sources.select_sources(is_noisy)
    all_solvable = np.ones(subset.n_sources, bool)
    excess = _estimate_initial_excess(subset) ** 2
    weights = downweighting_factor(subset.position / np.sqrt(subset.variance + excess[subset.source]))
    is_unsettled = np.ones(subset.n_sources, bool)
    for _ in range(_ROUNDS):
        squares, slopes = subset.sum_squares_and_slopes(weights, excess, all_solvable)
        next_excess = np.maximum(excess - squares / slopes * (squares / _count_dof(subset, weights) - 1), 0.0)
        step = np.abs(next_excess - excess)
        excess = np.where(is_unsettled, next_excess, excess)
        next_weights = downweighting_factor(
            subset.compute_residuals(weights, excess, all_solvable) / np.sqrt(subset.variance + excess[subset.source])
        )
        weights = np.where(is_unsettled[subset.source], next_weights, weights)
        is_unsettled = is_unsettled & (step > _TOLERANCE * excess)
        if not is_unsettled.any():
            break
    all_weights[is_theirs], all_variances[is_noisy] = weights, _find_excess_variance(subset, weights, all_solvable)
    return all_weights, all_variances


def _count_dof(sources, weight):
    """Count the degrees of freedom of each source of a group, without its outliers."""
    return np.maximum(sources.counts - sources.n_terms - sources.sum_per_source((weight < _OUTLIER).astype(float)), 1)


def _estimate_initial_excess(sources):
    """Estimate a first excess noise: half the range of the middle four sixths of the positions, and the median."""
    order = np.lexsort([sources.position, sources.source])
    positions, starts = sources.position[order], np.concatenate([[0], np.cumsum(sources.counts)[:-1]])

    def find_quantiles(share):
        ranks = share * (sources.counts - 1)
        lower = np.floor(ranks).astype(int)
        upper = np.minimum(lower + 1, sources.counts - 1)
        return positions[starts + lower] + (ranks - lower) * (positions[starts + upper] - positions[starts + lower])

    return (find_quantiles(5 / 6) - find_quantiles(1 / 6)) / 2 + np.abs(find_quantiles(1 / 2))


def _find_excess_variance(sources, weights, is_solvable):
    """Find the excess variance with which Σ w r²/(σ² + s²) equals the degrees of freedom; zero if it is below."""
    excess_variance, dof = np.zeros(sources.n_sources), _count_dof(sources, weights)
    square_sums, slopes = sources.sum_squares_and_slopes(weights, excess_variance, is_solvable)
    is_unsettled = square_sums > dof
    for _ in range(_STEPS + 1):
        next_variance = np.maximum(excess_variance - square_sums / slopes * (square_sums / dof - 1), 0.0)
        variance_step = np.abs(next_variance - excess_variance)
        excess_variance = np.where(is_unsettled, next_variance, excess_variance)
        is_unsettled = is_unsettled & (variance_step > _TOLERANCE * excess_variance)
        if not is_unsettled.any():
            break
        square_sums, slopes = sources.sum_squares_and_slopes(weights, excess_variance, is_solvable)
    return excess_variance
