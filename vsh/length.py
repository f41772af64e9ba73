"""Limits and intervals of the length of a vector whose errors are Gaussian, with any covariance.

Both rest on the vector of a given length that fits the data best: the direction of the true vector is not known, and
its error depends on it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtri, chndtr, ndtr, ndtri

from vsh.tools.types import ArrayLike, FloatArray

#: How many points stand for the noise: tails of 16 % are then known to 0.4 %.
_POINTS = 1024
#: Directions that are tried for the true vector besides the one that fits best, and how many points stand for the noise
#: there.
_DIRECTIONS, _FEWER_POINTS = 8, 256
#: How far those directions are from the best one, in the scatter of the noise, where errors differ by four and more and
#: the length is at most 1.4 of the largest error; less where errors are alike, and nothing for a length of two errors,
#: where the best direction alone has the coverage (all found by simulation, `benchmarks/lengths.py`).
_SHIFT, _NEAR, _FAR = 0.8, 1.4, 2.0
#: Lengths at which tails are computed, on a coarse and then on a fine grid; they are interpolated in between.
_COARSE, _FINE = 14, 6
#: A limit does not fall further for a vector that is shorter than this share of null vectors (it would by 2 %).
_SHORTEST_SHARE = 0.02
#: Tails by two approximations that differ by more than this factor are not both right.
_LEAST_AGREEMENT = 0.8
#: Newton's steps to the nearest vector of a length; it converges from one side, and six digits are enough.
_NEWTON_STEPS = 6


#: Fewer degrees of freedom determine no error: from three on Student's t has a variance.
FEWEST_DOF = 3


def standard_errors(variances: Any, dof: ArrayLike = np.inf) -> FloatArray:
    """Standard errors by variances that were estimated with so many degrees of freedom.

    Parameters
    ----------
    variances : (n,) array
        Diagonal of a covariance.
    dof : float or (n,) array
        Its degrees of freedom; inf of one that is known.

    Returns
    -------
    (n,) array
        The standard deviation of Student's t, √(dof/(dof − 2)) times that of the variance: as p-values and limits
        allow for few degrees of freedom, so do these. nan where fewer than three determine no error.
    """
    dof = np.asarray(dof, float)
    factors = 1 / (1 - 2 / np.where(dof < FEWEST_DOF, np.nan, dof))
    return np.asarray(np.sqrt(np.asarray(variances, float) * factors))


def length_interval(
    value: FloatArray, covariance: FloatArray, probability: float = 0.68, dof: float = np.inf
) -> tuple[float, float]:
    """Compute the interval of lengths that the data allow.

    Parameters
    ----------
    value : (k,) array
        The vector as estimated.
    covariance : (k, k) array
        Its covariance, positive definite.
    probability : float
        Coverage of the interval, between 0 and 1.
    dof : float
        Degrees of freedom of the covariance, if it was estimated from replicates.

    Returns
    -------
    tuple of two floats
        Lower and upper end, in the unit of `value`; the lower one is zero where a null vector is allowed.

    Notes
    -----
    The statistic is the profile q(L) = min (v − θ)ᵀ C⁻¹ (v − θ) over all θ of length L; a length is in the interval
    where a profile as large as the observed one is likely enough (Feldman & Cousins 1998, Phys. Rev. D 57, 3873, with
    the direction profiled), in the direction that fits best or in one of a few others that the data allow.
    The distribution of q is a sum over fixed points of a normal distribution, so that the same input gives the same
    interval. At L = 0 q is the χ² of `Vector.p_value`.
    """
    profile = _Profile(value, covariance, dof)
    tail = 1 - probability
    lower = 0.0 if profile.find_tails(np.zeros(1))[0] >= tail else profile.find_end(profile.lowest, profile.norm, tail)
    return lower, profile.find_end(profile.highest, profile.norm, tail)


def length_limits(
    values: FloatArray, covariances: FloatArray, probability: float = 0.95, dof: float = np.inf
) -> FloatArray:
    """Compute upper limits of lengths: a longer vector would have been found longer with this probability.

    Parameters
    ----------
    values : (n, k) array
        Vectors as estimated.
    covariances : (n, k, k) array
        Their covariances.
    probability : float
        Confidence of the limits, between 0 and 1.
    dof : float
        As for `length_interval`.

    Returns
    -------
    (n,) array
        In the unit of `values`.

    Notes
    -----
    A length L is excluded where a vector as short as the observed one is rare, for a true vector of that length in the
    direction where the data fit best, compared with how rare it is without any true vector (the method CLs; Read 2002,
    J. Phys. G 28, 2693): a downward fluctuation of the noise excludes no length to which the data are blind. The
    distribution of |v|² is taken in two approximations, and a length is excluded where both exclude it: a noncentral χ²
    of the same first four moments (Liu, Tang & Zhang 2009, Comput. Stat. Data Anal. 53, 853), exact where all errors
    are equal, and a power of a normal variable (Jensen & Solomon 1972, JASA 67, 898), good far in the lower tail.
    """
    variances, axes = np.linalg.eigh(covariances)
    components = np.einsum("nij,ni->nj", axes, values)
    variances = np.maximum(variances, 1e-12 * variances[:, -1:])
    sigma = np.sqrt(variances)
    # Nothing along the widest axis leaves the nearest vector undetermined; a millionth of an error does not.
    components = np.where(np.abs(components) < 1e-6 * sigma, 1e-6 * sigma, components)
    rank = np.sum(variances > 1e-10 * variances[:, -1:], axis=1)
    boost_square = chdtri(rank, 1 - _SHORTEST_SHARE) / np.sum(components**2 / variances, axis=1)
    components = components * np.sqrt(np.maximum(1.0, boost_square))[:, None]
    square = np.sum(components**2, axis=1)
    relative_variances, largest_sigma = variances / variances[:, -1:], sigma[:, -1]
    null_tails = _compute_shorter_probabilities(square, variances, np.zeros_like(components), dof)
    # Each may underestimate the tail of short vectors by any factor, which would exclude nothing; the larger one is
    # right to a few per cent, and the first is exact where all errors are equal.
    null_tail = np.maximum(null_tails, _LEAST_AGREEMENT * np.maximum(*null_tails))
    lower, upper = np.sqrt(square), np.sqrt(square) + _find_search_reach(dof, components.shape[1]) * largest_sigma
    for _ in range(30):
        middle_length = (lower + upper) / 2
        mu = _solve_lagrange_multiplier(components.T, relative_variances.T, middle_length)
        truth = components / (1 + mu[:, None] * relative_variances)
        tails = _compute_shorter_probabilities(square, variances, truth, dof)
        is_allowed = (np.array(tails) > (1 - probability) * null_tail).any(0)
        lower, upper = np.where(is_allowed, middle_length, lower), np.where(is_allowed, upper, middle_length)
    return upper


def _compute_shorter_probabilities(
    square: FloatArray, variances: FloatArray, truth: FloatArray, dof: float
) -> tuple[FloatArray, FloatArray]:
    """Compute the probability of a vector with a smaller |v|² than `square`, in two approximations, (n,) each."""
    excess = truth**2 / variances
    c1, c2, c3, c4 = (np.sum(variances**j * (1 + j * excess), axis=1) for j in (1, 2, 3, 4))
    # Liu, Tang & Zhang: scale a, degrees of freedom and noncentrality from the cumulants.
    skewness, kurtosis = c3 / c2**1.5, c4 / c2**2
    is_central = skewness**2 <= kurtosis
    a = 1 / (skewness - np.sqrt(np.where(is_central, 0.0, skewness**2 - kurtosis)))
    delta = np.where(is_central, 0.0, skewness * a**3 - a**2)
    degrees = np.where(is_central, c2**3 / c3**2, a**2 - 2 * delta)
    # Jensen & Solomon: (|v|²/c₁)^h is nearly normal.
    h = 1 - 2 * c1 * c3 / (3 * c2**2)
    h = np.where(np.abs(h) < 1e-3, 1e-3, h)
    mean, scatter = 1 + c2 * h * (h - 1) / c1**2, np.sqrt(2 * c2) * np.abs(h) / c1
    sums = [np.zeros_like(square), np.zeros_like(square)]
    variance_scales = _compute_variance_scales(dof, truth.shape[1])
    for variance_scale in variance_scales:
        scaled_square = square * variance_scale
        statistic = (scaled_square - c1) / np.sqrt(2 * c2) * np.sqrt(2) * a + degrees + delta
        sums[0] += chndtr(np.maximum(statistic, 0.0), degrees, delta)
        sums[1] += ndtr(np.sign(h) * ((scaled_square / c1) ** h - mean) / scatter)
    return np.maximum(sums[0] / len(variance_scales), 1e-9), np.maximum(sums[1] / len(variance_scales), 1e-9)


def _compute_variance_scales(dof: float, n_components: int) -> FloatArray:
    """Compute equally likely factors between estimated and true variances: of k components, one if they are known."""
    if np.isinf(dof):
        return np.ones(1)
    degrees = dof - n_components + 1
    return chdtri(degrees, (np.arange(16) + 0.5) / 16) / dof


def _find_search_reach(dof: float, n_components: int) -> float:
    """Find the distance beyond its length that a vector may have, in its largest errors."""
    return 6.0 if np.isinf(dof) else 6.0 + 60.0 / max(dof - n_components + 1, 1.0)


class _Profile:
    """The profile q(L) of one vector along its principal axes, in units of its largest error."""

    def __init__(self, value: FloatArray, covariance: FloatArray, dof: float) -> None:
        variances, axes = np.linalg.eigh(covariance)
        self.unit = float(np.sqrt(variances[-1]))
        components = axes.T @ np.asarray(value, float) / self.unit
        # Axes along which there is neither a value nor an error, as of the trace of a shear, are none.
        is_axis = (variances > 1e-12 * variances[-1]) | (np.abs(components) > 1e-9 * np.abs(components).max())
        self.variances = np.maximum(variances[is_axis] / variances[-1], 1e-12)
        smallest = 1e-6 * np.sqrt(self.variances)  # as in `length_limits`
        self.value = np.where(np.abs(components[is_axis]) < smallest, smallest, components[is_axis])
        self.norm = float(np.linalg.norm(self.value))
        self.unequal = float(np.clip((1 / np.sqrt(self.variances.min()) - 1) / 3, 0.0, 1.0))
        # Hotelling's T² with k components is k ν/(ν − k + 1) times an F with k and ν − k + 1 degrees of freedom.
        self.dof, self.free = dof, dof - len(self.value) + 1
        self.noise = np.sqrt(self.variances)[:, None] * _make_normal_points(len(self.value))
        reach = _find_search_reach(dof, len(self.value))
        self.lowest, self.highest = max(self.norm - reach, 0.0), self.norm + reach

    def find_tails(self, lengths: FloatArray) -> FloatArray:
        """Compute the probability of a profile as large as the observed one, for true vectors of these lengths, (m,).

        The largest over the direction that fits best and a few that the data allow as well.
        """
        nearest, observed = self._find_nearest(self.value[:, None, None], lengths)
        tails = self._get_tails(nearest, self.noise, lengths, observed)
        offsets = self.noise[:, None, :: _POINTS // _DIRECTIONS]
        shifts = _SHIFT * self.unequal * np.clip((_FAR - lengths) / (_FAR - _NEAR), 0.0, 1.0)
        shifted = shifts > 0
        if not shifted.any():
            return tails
        vectors, _ = self._find_nearest(self.value[:, None, None] + shifts[shifted, None] * offsets, lengths[shifted])
        few_points = self.noise[:, 1 :: _POINTS // _FEWER_POINTS]
        for k in range(vectors.shape[2]):
            direction_tails = self._get_tails(vectors[:, :, k : k + 1], few_points, lengths[shifted], observed[shifted])
            tails[shifted] = np.maximum(tails[shifted], direction_tails)
        return tails

    def _get_tails(self, truth: FloatArray, noise: FloatArray, lengths: FloatArray, observed: FloatArray) -> FloatArray:
        """Compute tail probabilities for given true vectors, (k, m, 1), and points of the noise, (k, n)."""
        _, profiles = self._find_nearest(truth + noise[:, None, :], lengths)
        if np.isinf(self.dof):
            return np.mean(profiles >= observed, axis=1)
        return chdtr(self.free, self.dof * profiles / np.maximum(observed, 1e-300)).mean(axis=1)

    def find_end(self, lower: float, upper: float, tail: float) -> float:
        """Find the length between two at which the tail is `tail`, nearest to the one that the data do not allow.

        lower : float
            Not allowed, in units of the largest error.
        upper : float
            Allowed.
        """
        for n_lengths in (_COARSE, _FINE):
            lengths = np.linspace(lower, upper, n_lengths)
            deviates = ndtri(np.clip(self.find_tails(lengths), 1e-9, 1 - 1e-9)) - ndtri(tail)
            crossing = int(np.argmax(deviates > 0))
            if crossing == 0:
                return float(lengths[0] if deviates[0] > 0 else lengths[-1]) * self.unit
            lower, upper = lengths[crossing - 1], lengths[crossing]
        share = deviates[crossing - 1] / (deviates[crossing - 1] - deviates[crossing])
        return float(lower + share * (upper - lower)) * self.unit

    def _find_nearest(self, vectors: FloatArray, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Find the vectors of given lengths nearest to `vectors` in their errors, (k, m, n), and the profile (m, n)."""
        variances, length = self.variances[:, None, None], lengths[:, None]
        mu = _solve_lagrange_multiplier(vectors, variances, np.maximum(length, 1e-12))
        theta = vectors / (1 + mu * variances)
        profiles = (theta**2 * variances).sum(axis=0) * mu**2
        null_profile = np.broadcast_to((vectors**2 / variances).sum(axis=0), profiles.shape)
        return np.where(length > 0, theta, 0.0), np.where(length > 0, profiles, null_profile)


def _solve_lagrange_multiplier(vectors: FloatArray, variances: FloatArray, length: FloatArray) -> FloatArray:
    """Solve for µ at which θ = v/(1 + µσ²), the nearest vector to v, has a length; components first, widest axis last.

    Newton's method on 1/|θ|, which is nearly straight in µ.
    """
    # At this µ the component along the widest axis alone has the whole length: the root lies above.
    mu = np.abs(vectors[-1]) / length - 1
    squares = vectors**2
    for _ in range(_NEWTON_STEPS):
        stretch = 1 / (1 + mu * variances)
        squared_components = squares * stretch**2
        square_length = squared_components.sum(axis=0)
        slope = (squared_components * variances * stretch).sum(axis=0)
        mu = mu + square_length / slope * (np.sqrt(square_length) / length - 1)
    return mu


@lru_cache(maxsize=8)
def _make_normal_points(n_components: int) -> Any:
    """Make points of a normal distribution of so many components, each with its mirror image, (size, _POINTS)."""
    # Kronecker's sequence of the generalised golden ratio fills the unit cube evenly.
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (n_components + 1))
    step = ratio ** -np.arange(1.0, n_components + 1)
    half_points = ndtri((0.5 + np.outer(step, np.arange(1, _POINTS // 2 + 1))) % 1)
    return np.concatenate([half_points, -half_points], axis=1)
