"""The distribution of a sum of squares of Gaussian numbers that are neither central nor of one variance."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from vsh.types import FloatArray


def probability_above(x: float, variances: FloatArray, shifts: FloatArray) -> float:
    """P(Σ λ_i (z_i + δ_i)² > x) with z_i ~ N(0, 1), by inversion of the characteristic function.

    Parameters
    ----------
    x : float
        The value.
    variances : (n,) array
        λ, positive.
    shifts : (n,) array
        δ.

    Notes
    -----
    Imhof (1961, Biometrika 48, 419), eq. 3.2.

    Examples
    --------
    >>> round(probability_above(7.81473, np.ones(3), np.zeros(3)), 5)  # χ² with three degrees of freedom
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

    value, _ = quad(integrand, 0, np.inf, limit=500, epsabs=1e-8)
    return float(np.clip(0.5 + value / np.pi, 0, 1))


def quantile(probability: float, variances: FloatArray, shifts: FloatArray) -> float:
    """The value below which Σ λ_i (z_i + δ_i)² lies with a probability.

    Parameters
    ----------
    probability : float
        Between 0 and 1.
    variances : (n,) array
        λ, positive.
    shifts : (n,) array
        δ.
    """
    mean = np.sum(variances * (1 + shifts**2))
    spread = np.sqrt(np.sum(2 * variances**2 * (1 + 2 * shifts**2)))
    high = mean + 3 * spread
    while probability_above(high, variances, shifts) > 1 - probability:
        high += 3 * spread
    return float(brentq(lambda x: 1 - probability - probability_above(x, variances, shifts), 0, high, xtol=1e-9 * high))
