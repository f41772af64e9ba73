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
_SQUARE, _CUBE = 3 - 10 / 3 * np.exp(-1.0), 2 - 7 / 3 * np.exp(-1.0)
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
    cubic = 1 - _SQUARE * (z - 2) ** 2 + _CUBE * (z - 2) ** 3
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
    n = int(source[-1]) + 1 if len(source) else 0
    columns = design if colour is None else np.vstack([design, -np.asarray(colour, float)])
    sums = _LeastSquares(source, n, columns, position, error)
    good = sums.solvable()
    weight, variance = np.ones(len(source)), np.zeros(n)
    if robust:
        weight, variance = _robust_weights(sums, good)
    values, inverse = sums.solved(weight, variance, good)
    outliers = sums.sum_per_source((weight < _OUTLIER).astype(float)).astype(int)
    five = FiveParameters(values[:, :5], inverse[:, :5, :5], np.sqrt(variance), sums.counts, outliers, weight)
    if colour is None:
        return five
    return replace(five, pseudocolour=values[:, 5], pseudocolour_error=np.sqrt(inverse[:, 5, 5]))


class _LeastSquares:
    """Observations of many sources, and least squares of each with any weights."""

    def __init__(self, source, n, design, position, error):
        self.source, self.n, self.design, self.position = source, n, design, position
        self.noise = np.asarray(error, float) ** 2
        self.counts = np.bincount(source, minlength=n)
        self.parameters = len(design)

    def sum_per_source(self, values):
        return np.bincount(self.source, values, self.n)

    def normal(self, weight, variance):
        """N, (n, 5, 5), and right-hand sides, (n, 5)."""
        w = weight / (self.noise + variance[self.source])
        matrix, rhs = np.empty((self.n, self.parameters, self.parameters)), np.empty((self.n, self.parameters))
        for i in range(self.parameters):
            weighted_row = w * self.design[i]
            rhs[:, i] = self.sum_per_source(weighted_row * self.position)
            for j in range(i + 1):
                matrix[:, i, j] = matrix[:, j, i] = self.sum_per_source(weighted_row * self.design[j])
        if self.parameters > 5:
            matrix[:, 5, 5] += 1 / COLOUR_PRIOR**2
        return matrix, rhs

    def solvable(self):
        """More observations than parameters, and scans in more than one direction and time."""
        matrix = self.normal(np.ones(len(self.source)), np.zeros(self.n))[0][:, :5, :5]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", matrix), 1e-300))
        scaled_matrix = matrix / (scale[:, :, None] * scale[:, None])
        return (self.counts > self.parameters) & (np.linalg.eigvalsh(scaled_matrix)[:, 0] > 1e-6)

    def solved(self, weight, variance, good):
        """Parameters, (n, 5), and their covariance; nan where there is none."""
        matrix, rhs = self.normal(weight, variance)
        values, inverse = np.full(rhs.shape, np.nan), np.full(matrix.shape, np.nan)
        inverse[good] = np.linalg.inv(matrix[good])
        values[good] = np.einsum("nij,nj->ni", inverse[good], rhs[good])
        return values, inverse

    def residual(self, weight, variance, good):
        values, _ = self.solved(weight, variance, good)
        return self.position - np.einsum("ki,ik->k", np.nan_to_num(values)[self.source], self.design)

    def squares(self, weight, variance, good):
        """Σ w r²/(σ² + s²) of every source and its slope by s²."""
        share = 1 / (self.noise + variance[self.source])
        terms = weight * self.residual(weight, variance, good) ** 2 * share
        return self.sum_per_source(terms), -self.sum_per_source(terms * share)

    def of(self, selection):
        """Only some of the sources, numbered anew, and which observations are theirs."""
        inside = selection[self.source]
        number = np.cumsum(selection) - 1
        design, position, error = self.design[:, inside], self.position[inside], np.sqrt(self.noise[inside])
        return _LeastSquares(number[self.source[inside]], int(selection.sum()), design, position, error), inside


def _robust_weights(sums, good):
    """Weights of the observations and variances of the excess noise."""
    weight, variance = np.ones(len(sums.source)), np.zeros(sums.n)
    squares, _ = sums.squares(weight, variance, good)
    noisy = good & (squares > sums.counts - sums.parameters)  # the others are as their errors say
    if not noisy.any():
        return weight, variance
    subset, inside = sums.of(noisy)
    all_of = np.ones(subset.n, bool)
    excess = _dispersion(subset) ** 2
    mine = downweighting_factor(subset.position / np.sqrt(subset.noise + excess[subset.source]))
    moving = np.ones(subset.n, bool)
    for _ in range(_ROUNDS):
        squares, slope = subset.squares(mine, excess, all_of)
        following = np.maximum(excess - squares / slope * (squares / _degrees_of_freedom(subset, mine) - 1), 0.0)
        step = np.abs(following - excess)
        excess = np.where(moving, following, excess)
        fresh = downweighting_factor(
            subset.residual(mine, excess, all_of) / np.sqrt(subset.noise + excess[subset.source])
        )
        mine = np.where(moving[subset.source], fresh, mine)
        moving = moving & (step > _TOLERANCE * excess)
        if not moving.any():
            break
    weight[inside], variance[noisy] = mine, _excess_variance(subset, mine, all_of)
    return weight, variance


def _degrees_of_freedom(sums, weight):
    """Degrees of freedom, outliers not counted."""
    return np.maximum(sums.counts - sums.parameters - sums.sum_per_source((weight < _OUTLIER).astype(float)), 1)


def _dispersion(sums):
    """Half the range of the middle four sixths of the positions, and the median's size: a first excess noise."""
    order = np.lexsort([sums.position, sums.source])
    positions, starts = sums.position[order], np.concatenate([[0], np.cumsum(sums.counts)[:-1]])

    def quantile(share):
        at = share * (sums.counts - 1)
        lower = np.floor(at).astype(int)
        upper = np.minimum(lower + 1, sums.counts - 1)
        return positions[starts + lower] + (at - lower) * (positions[starts + upper] - positions[starts + lower])

    return (quantile(5 / 6) - quantile(1 / 6)) / 2 + np.abs(quantile(1 / 2))


def _excess_variance(sums, weight, all_of):
    """The excess variance with which Σ w r²/(σ² + s²) equals the degrees of freedom; zero if it is smaller anyway."""
    excess, freedom = np.zeros(sums.n), _degrees_of_freedom(sums, weight)
    squares, slope = sums.squares(weight, excess, all_of)
    moving = squares > freedom
    for _ in range(_STEPS + 1):
        following = np.maximum(excess - squares / slope * (squares / freedom - 1), 0.0)
        step = np.abs(following - excess)
        excess = np.where(moving, following, excess)
        moving = moving & (step > _TOLERANCE * excess)
        if not moving.any():
            break
        squares, slope = sums.squares(weight, excess, all_of)
    return excess
