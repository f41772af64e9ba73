"""Laws of power by degree, as arrays of T and S."""

from __future__ import annotations

import numpy as np

from vsh.checks.types import FloatArray, IntArray
from vsh.errors import ModesError


def wave_fractions(lmax: int) -> FloatArray:
    """Share of each degree in the power of a stochastic gravitational-wave background, (lmax,).

    α_l = 24 (2l + 1) / [(l − 1) l² (l + 1)² (l + 2)]: 5/6, 7/60, 3/100, … from l = 2 on; they
    sum to 1. The fractions are those of Book & Flanagan (2011, PhRvD 83, 024024), table 1.

    Parameters
    ----------
    lmax : int
        The highest degree.

    Examples
    --------
    >>> wave_fractions(4).round(6)
    array([0.      , 0.833333, 0.116667, 0.03    ])
    """
    l = np.arange(2, lmax + 1.0)
    return np.r_[0.0, 24 * (2 * l + 1) / ((l - 1) * l**2 * (l + 1) ** 2 * (l + 2))]


def both(power: FloatArray) -> FloatArray:
    """One power for T and S."""
    return np.stack([power, power])


def is_odd(lmax: int) -> IntArray:
    """Whether the fields of T and S of each degree are those of a spin's parity, (2, lmax)."""
    odd = np.arange(1, lmax + 1) % 2 == 1
    return np.stack([odd, ~odd])


def cut(power: FloatArray, lmax: int, name: str) -> FloatArray:
    """The first degrees of a given spectrum, (2, lmax)."""
    if lmax > power.shape[1]:
        raise ModesError(f"the spectrum {name} is given to degree {power.shape[1]}, and degree {lmax} is wanted")
    return power[:, :lmax]


def without_rounding(power: FloatArray) -> FloatArray:
    """What is negative by the rounding of an integral alone is zero."""
    return np.where(np.abs(power) < 1e-10 * np.abs(power).max(), 0.0, power)
