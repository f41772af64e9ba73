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


def design_row(angle: FloatArray, parallax_factor: FloatArray, time: FloatArray) -> FloatArray:
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
        Columns from `design_row`.
    position, error : (k,) arrays
        Along scan, and its standard error.
    colour : (k,) array, optional
        The colour factor, −∂w/∂ν: a correction of the effective wavenumber is then a sixth parameter, known to be
        within `COLOUR_PRIOR` of zero as in DR4. [unit of the observations × µm]
    robust : bool
        Weights and excess noise as AGIS has them; plain least squares otherwise.
    """
    n_sources = int(source[-1]) + 1 if len(source) else 0
    columns = design if colour is None else np.vstack([design, -np.asarray(colour, float)])
    sources = _LeastSquares(source, n_sources, columns, position, error)
    is_solvable = sources.find_solvable()
    weights, variances = np.ones(len(source)), np.zeros(n_sources)
    if robust:
        weights, variances = _find_robust_weights(sources, is_solvable)
    values, inverse = sources.solve(weights, variances, is_solvable)
    outliers = sources.sum_per_source((weights < _OUTLIER).astype(float)).astype(int)
    solution = FiveParameters(values[:, :5], inverse[:, :5, :5], np.sqrt(variances), sources.counts, outliers, weights)
    if colour is None:
        return solution
    return replace(solution, pseudocolour=values[:, 5], pseudocolour_error=np.sqrt(inverse[:, 5, 5]))


class _LeastSquares:
    """Observations of many sources, and least squares of each with any weights."""

    def __init__(self, source, n, design, position, error):
        self.source, self.n, self.design, self.position = source, n, design, position
        self.noise = np.asarray(error, float) ** 2
        self.counts = np.bincount(source, minlength=n)
        self.parameters = len(design)

    def sum_per_source(self, values):
        return np.bincount(self.source, values, self.n)

    def compute_normal(self, weight, variance):
        """Compute the normal matrices, (n, 5, 5), and right-hand sides, (n, 5)."""
        inverse_variance = weight / (self.noise + variance[self.source])
        matrix, rhs = np.empty((self.n, self.parameters, self.parameters)), np.empty((self.n, self.parameters))
        for i in range(self.parameters):
            weighted_row = inverse_variance * self.design[i]
            rhs[:, i] = self.sum_per_source(weighted_row * self.position)
            for j in range(i + 1):
                matrix[:, i, j] = matrix[:, j, i] = self.sum_per_source(weighted_row * self.design[j])
        if self.parameters > 5:
            matrix[:, 5, 5] += 1 / COLOUR_PRIOR**2
        return matrix, rhs

    def find_solvable(self):
        """Find which sources have more observations than parameters, and scans in several directions and times."""
        matrix = self.compute_normal(np.ones(len(self.source)), np.zeros(self.n))[0][:, :5, :5]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", matrix), 1e-300))
        scaled_matrix = matrix / (scale[:, :, None] * scale[:, None])
        return (self.counts > self.parameters) & (np.linalg.eigvalsh(scaled_matrix)[:, 0] > 1e-6)

    def solve(self, weight, variance, is_solvable):
        """Solve for the parameters, (n, 5), and their covariance; nan where there is no solution."""
        matrix, rhs = self.compute_normal(weight, variance)
        values, inverse = np.full(rhs.shape, np.nan), np.full(matrix.shape, np.nan)
        inverse[is_solvable] = np.linalg.inv(matrix[is_solvable])
        values[is_solvable] = np.einsum("nij,nj->ni", inverse[is_solvable], rhs[is_solvable])
        return values, inverse

    def compute_residuals(self, weight, variance, is_solvable):
        values, _ = self.solve(weight, variance, is_solvable)
        return self.position - np.einsum("ki,ik->k", np.nan_to_num(values)[self.source], self.design)

    def sum_squares(self, weight, variance, is_solvable):
        """Compute Σ w r²/(σ² + s²) of every source and its slope by s²."""
        inverse_variance = 1 / (self.noise + variance[self.source])
        terms = weight * self.compute_residuals(weight, variance, is_solvable) ** 2 * inverse_variance
        return self.sum_per_source(terms), -self.sum_per_source(terms * inverse_variance)

    def select(self, is_selected):
        """Select some of the sources, numbered anew, and find which observations are theirs."""
        is_theirs = is_selected[self.source]
        number = np.cumsum(is_selected) - 1
        design, position, error = self.design[:, is_theirs], self.position[is_theirs], np.sqrt(self.noise[is_theirs])
        return _LeastSquares(number[self.source[is_theirs]], int(is_selected.sum()), design, position, error), is_theirs


def _find_robust_weights(sources, is_solvable):
    """Find the weights of the observations and the variances of the excess noise, in turn."""
    weight, variance = np.ones(len(sources.source)), np.zeros(sources.n)
    squares, _ = sources.sum_squares(weight, variance, is_solvable)
    is_noisy = is_solvable & (squares > sources.counts - sources.parameters)  # the others are as their errors say
    if not is_noisy.any():
        return weight, variance
    subset, is_theirs = sources.select(is_noisy)
    everything = np.ones(subset.n, bool)
    excess = _estimate_dispersion(subset) ** 2
    weights = downweighting_factor(subset.position / np.sqrt(subset.noise + excess[subset.source]))
    is_moving = np.ones(subset.n, bool)
    for _ in range(_ROUNDS):
        squares, slope = subset.sum_squares(weights, excess, everything)
        next_excess = np.maximum(excess - squares / slope * (squares / _count_dof(subset, weights) - 1), 0.0)
        step = np.abs(next_excess - excess)
        excess = np.where(is_moving, next_excess, excess)
        next_weights = downweighting_factor(
            subset.compute_residuals(weights, excess, everything) / np.sqrt(subset.noise + excess[subset.source])
        )
        weights = np.where(is_moving[subset.source], next_weights, weights)
        is_moving = is_moving & (step > _TOLERANCE * excess)
        if not is_moving.any():
            break
    weight[is_theirs], variance[is_noisy] = weights, _find_excess_variance(subset, weights, everything)
    return weight, variance


def _count_dof(group, weight):
    """Count the degrees of freedom of each source of a group, without its outliers."""
    return np.maximum(group.counts - group.parameters - group.sum_per_source((weight < _OUTLIER).astype(float)), 1)


def _estimate_dispersion(sources):
    """Estimate a first excess noise: half the range of the middle four sixths of the positions, and the median."""
    order = np.lexsort([sources.position, sources.source])
    positions, starts = sources.position[order], np.concatenate([[0], np.cumsum(sources.counts)[:-1]])

    def find_quantile(share):
        rank = share * (sources.counts - 1)
        lower = np.floor(rank).astype(int)
        upper = np.minimum(lower + 1, sources.counts - 1)
        return positions[starts + lower] + (rank - lower) * (positions[starts + upper] - positions[starts + lower])

    return (find_quantile(5 / 6) - find_quantile(1 / 6)) / 2 + np.abs(find_quantile(1 / 2))


def _find_excess_variance(sources, weight, is_solvable):
    """Find the excess variance with which Σ w r²/(σ² + s²) equals the degrees of freedom; zero if it is below."""
    excess, dof = np.zeros(sources.n), _count_dof(sources, weight)
    squares, slope = sources.sum_squares(weight, excess, is_solvable)
    is_moving = squares > dof
    for _ in range(_STEPS + 1):
        next_excess = np.maximum(excess - squares / slope * (squares / dof - 1), 0.0)
        step = np.abs(next_excess - excess)
        excess = np.where(is_moving, next_excess, excess)
        is_moving = is_moving & (step > _TOLERANCE * excess)
        if not is_moving.any():
            break
        squares, slope = sources.sum_squares(weight, excess, is_solvable)
    return excess
