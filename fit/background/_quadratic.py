"""The distribution of a sum of squares of Gaussian numbers that are neither central nor of one variance."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from fit.background._equations import places
from fit.normal import NormalEquations
from vsh.checks.types import FloatArray

#: Of a probability.
_ACCURACY = 1e-7


def probability_above(x: float, variances: FloatArray, shifts: FloatArray) -> float:
    """P(Σ λ_i (z_i + δ_i)² > x) with z_i ~ N(0, 1), by inversion of the characteristic function.

    Notes
    -----
    Imhof (1961, Biometrika 48, 419), eq. 3.2.

    Examples
    --------
    >>> round(probability_above(18.30704, np.ones(10), np.zeros(10)), 5)  # χ² with ten degrees of freedom
    0.05
    """
    scale = variances.max()
    ratio, x = variances / scale, x / scale

    def integrand(u):
        y = ratio * u
        inner = 1 + y * y
        angle = np.sum(np.arctan(y) + shifts**2 * y / inner) / 2 - x * u / 2
        size = np.sum(np.log(inner) / 4 + shifts**2 * y * y / inner / 2)
        return np.sin(angle) / u * np.exp(-size)

    # What is left beyond the end: at most 1/(π k U^k √Πr) with k = n/2 (his eq. 3.4).
    k = len(ratio) / 2
    end = np.exp(-(np.log(np.pi * k * _ACCURACY) + np.sum(np.log(ratio)) / 2) / k)
    value, _ = quad(integrand, 0, end, limit=2000, epsabs=_ACCURACY)
    return float(np.clip(0.5 + value / np.pi, 0, 1))


def quantile(probability: float, variances: FloatArray, shifts: FloatArray) -> float:
    """The value below which Σ λ_i (z_i + δ_i)² lies with a probability."""
    mean = np.sum(variances * (1 + shifts**2))
    spread = np.sqrt(np.sum(2 * variances**2 * (1 + 2 * shifts**2)))
    high = mean + 3 * spread
    while probability_above(high, variances, shifts) > 1 - probability:
        high += 3 * spread
    return float(brentq(lambda x: 1 - probability - probability_above(x, variances, shifts), 0, high, xtol=1e-9 * high))


def squares_of(equations: NormalEquations, lmax: int, scaled: bool) -> tuple[float, float, FloatArray]:
    """P_2, its noise, and the variances and shifts of its terms, (2, 10), in the fit of all degrees to lmax.

    All are nan where the data do not determine them. [(µas/yr)²]
    """
    modes = equations.modes
    where = places(modes, range(1, lmax + 1))
    matrix, rhs = equations.matrix[np.ix_(where, where)], equations.rhs[where]
    second = np.flatnonzero(modes.degrees[where] == 2)
    if equations.n_data <= len(where) or np.linalg.cond(matrix) > 1e12:
        return float("nan"), float("nan"), np.full((2, len(second)), np.nan)
    covariance = np.linalg.inv(matrix)
    values = covariance @ rhs
    scale = (equations.chi2_null - values @ rhs) / (equations.n_data - len(where)) if scaled else 1.0
    root = np.sqrt(modes.norm2[where][second])
    variances, vectors = np.linalg.eigh(scale * covariance[np.ix_(second, second)] * np.outer(root, root))
    shifts = vectors.T @ (root * values[second]) / np.sqrt(variances)
    return float(np.sum(variances * shifts**2)), float(variances.sum()), np.array([variances, shifts])
