"""How motions at an angle θ are correlated: Wigner's functions of spin 1, and functions that were published.

Two motions are compared by carrying one along the great circle to the other. The components along and across it give
ξ± = ⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩, and

    ξ+ = Σ (P_T + P_S)_l d⁺_l/4π,   ξ− = Σ (P_T − P_S)_l d⁻_l/4π.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vsh.checks.arrays import float_array
from vsh.checks.types import ArrayLike, FloatArray
from vsh.errors import ParameterError

#: Panels of 16 nodes in the integral over θ, at least, and the power by which they crowd towards zero.
_PANELS, _GRADING = 250, 3


def d_plus(lmax: int, theta: ArrayLike) -> FloatArray:
    """d⁺_l = d^l_{11}(θ) = ½ (1 + x) P^{(0,2)}_{l−1}(x), x = cos θ, for l = 1 … lmax.

    Parameters
    ----------
    lmax : int
        The highest degree.
    theta : (n,) array
        Angles. [rad]

    Examples
    --------
    >>> d_plus(2, [0.0, np.pi]).round(12)
    array([[ 1.,  0.],
           [ 1., -0.]])
    """
    x = np.cos(np.atleast_1d(np.asarray(theta, float)))
    out = np.empty((lmax, x.size))
    # Jacobi's polynomials with (0, 2), by their recurrence.
    below, p = np.zeros_like(x), np.ones_like(x)
    for n in range(lmax):
        out[n] = p
        k, c = n + 1, 2 * (n + 1) + 2
        above = (c - 1) * (c * (c - 2) * x - 4) * p - 2 * (k - 1) * (k + 1) * c * below
        below, p = p, above / (2 * k * (k + 2) * (c - 2))
    return (1 + x) / 2 * out


def d_minus(lmax: int, theta: ArrayLike) -> FloatArray:
    """d⁻_l = ½ (1 − x) P^{(2,0)}_{l−1}(x) = (−1)^{l−1} d⁺_l(π − θ) for l = 1 … lmax.

    Parameters
    ----------
    lmax : int
        The highest degree.
    theta : (n,) array
        Angles. [rad]
    """
    signs = (-1.0) ** np.arange(lmax)
    return signs[:, None] * d_plus(lmax, np.pi - np.atleast_1d(np.asarray(theta, float)))


def power_of(function: Callable[[FloatArray], FloatArray], lmax: int) -> FloatArray:
    """P_l = 2π (2l + 1) ∫ V d⁺_l sin θ dθ, the power of one kind, for l = 1 … lmax. [(µas/yr)²]"""
    node, weight = np.polynomial.legendre.leggauss(16)
    panels = max(_PANELS, lmax)
    u = ((np.arange(panels)[:, None] + (node + 1) / 2) / panels).ravel()
    theta = np.pi * u**_GRADING
    value = values_of(function, theta) * np.sin(theta) * _GRADING * np.pi * u ** (_GRADING - 1)
    value *= np.tile(weight / (2 * panels), panels)
    l = np.arange(1, lmax + 1)
    return 2 * np.pi * (2 * l + 1) * (d_plus(lmax, theta) @ value)


def values_of(function: Callable[[FloatArray], FloatArray], theta: FloatArray) -> FloatArray:
    """V at some angles, of their shape and finite. [(µas/yr)²]"""
    if not callable(function):
        raise ParameterError(f"a covariance function V(θ) takes angles in rad, not {type(function).__name__}")
    return float_array("V(θ)", function(theta), theta.shape, broadcast=True)


def VASILIEV_BAUMGARDT_2021(theta: ArrayLike) -> FloatArray:
    """V(θ) of Gaia EDR3: 400/(1 + θ/0.3°) + 300 exp(−θ/12°). [(µas/yr)²]

    Parameters
    ----------
    theta : array
        Angles. [rad]

    Notes
    -----
    Vasiliev & Baumgardt (2021, MNRAS 505, 5978). Taken literally it exceeds what quasars show at low degrees a few
    times: simulate with it, and estimate low degrees from the data (`fit.background.floor`).
    """
    degrees = np.degrees(theta)
    return 400 / (1 + degrees / 0.3) + 300 * np.exp(-degrees / 12)


def LINDEGREN_2021(theta: ArrayLike) -> FloatArray:
    """V(θ) of Gaia EDR3 at large angles: 292 exp(−θ/12°). [(µas/yr)²]

    Parameters
    ----------
    theta : array
        Angles. [rad]

    Notes
    -----
    Lindegren et al. (2021, A&A 649, A2). The note on `VASILIEV_BAUMGARDT_2021` holds for it as well.
    """
    return 292 * np.exp(-np.degrees(theta) / 12)
