"""Gaussian random fields of a given power, gravitational waves among them."""

from __future__ import annotations

import numpy as np

from sim.signal._galaxies import hubble_rate
from sim.signal._signal import Signal, from_coefficients
from vsh import Coefficients, Modes
from vsh.checks import arguments
from vsh.checks.arguments import generator, not_negative
from vsh.checks.arrays import float_array
from vsh.errors import ParameterError
from vsh.types import ArrayLike, FloatArray, Rng


@arguments.accepts(rng=arguments.seed)
def random_field(power: ArrayLike, rng: Rng) -> Signal:
    """A Gaussian random field with a given power of each degree, the same for T and S.

    Parameters
    ----------
    power : (lmax,) array
        ∫ |V_l|² dΩ of one kind, on average [(µas/yr)²]
    rng : Generator or int
        The source of all randomness.

    Returns
    -------
    Signal

    Raises
    ------
    ParameterError
        If the power is not one number of at least zero for each degree.
    """
    power = float_array("power", power)
    if power.ndim != 1 or not len(power) or (power < 0).any():
        raise ParameterError("power is one number of at least zero for each degree from 1 on")
    modes = Modes(len(power))
    l = modes.degrees
    sigma = np.sqrt(power[l - 1] / (2 * l + 1) / modes.norm2)
    return from_coefficients(Coefficients(modes, sigma * generator(rng).standard_normal(len(modes))))


def wave_fractions(lmax: int) -> FloatArray:
    """Share of each degree in the power of a stochastic gravitational-wave background, (lmax,).

    α_l = 24 (2l + 1) / [(l − 1) l² (l + 1)² (l + 2)]: 5/6, 7/60, 3/100, … from l = 2 on; they
    sum to 1. The fractions are those of Book & Flanagan (2011, PhRvD 83, 024024), table 1.

    Parameters
    ----------
    lmax : int
        The highest degree.

    Returns
    -------
    array

    Examples
    --------
    >>> wave_fractions(4).round(6)
    array([0.      , 0.833333, 0.116667, 0.03    ])
    """
    l = np.arange(2, lmax + 1.0)
    return np.r_[0.0, 24 * (2 * l + 1) / ((l - 1) * l**2 * (l + 1) ** 2 * (l + 2))]


def gravitational_waves(omega: float, rng: Rng, *, hubble: float = 70.0, lmax: int = 12) -> Signal:
    """One draw of a stochastic background of gravitational waves longer than the observations.

    Its mean square motion is H0² Ω_GW, so that the quadrupole obeys
    Ω_GW = (6/5) P_2/(4π H0²), half of P_2 in T and half in S.

    Parameters
    ----------
    omega : float
        Ω_GW.
    rng : Generator or int
        The source of all randomness.
    hubble : float
        [km/s/Mpc]
    lmax : int
        The highest degree.

    Returns
    -------
    Signal
    """
    total = 4 * np.pi * not_negative("omega", omega) * hubble_rate(hubble) ** 2
    return random_field(total * wave_fractions(lmax) / 2, rng)
