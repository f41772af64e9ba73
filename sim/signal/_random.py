"""Gaussian random fields of a given spectrum: errors that a catalogue shares over the sky, gravitational waves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from sim.signal._signal import Signal, from_coefficients
from vsh import Coefficients
from vsh.checks import arguments
from vsh.checks.arguments import generator, not_negative
from vsh.checks.types import ArrayLike, FloatArray, Rng
from vsh.covariance import Spectrum
from vsh.modes import as_modes


@arguments.accepts(rng=arguments.seed)
def systematics(
    spectrum: Spectrum | Callable[[FloatArray], FloatArray],
    rng: Rng,
    *,
    parity: Literal["odd", "even"] | None = None,
    lmax: int = 24,
) -> Signal:
    """Errors that a catalogue shares over the sky: one draw of a Gaussian field of a given spectrum.

    Parameters
    ----------
    spectrum : Spectrum or function of θ [rad]
        The mean power of each kind and degree, or the covariance V(θ) of motions at an angle θ, such as
        `vsh.covariance.LINDEGREN_2021`. [(µas/yr)²]
    rng : Generator or int
        The source of all randomness.
    parity : {"odd", "even"}, optional
        Only the fields that a spin belongs to, or only those a glide belongs to; both unless given.
    lmax : int
        The highest degree of the field; 24 resolves 7°.

    Raises
    ------
    ParameterError
        If the power of a degree is negative.

    Examples
    --------
    >>> field = systematics(5 * Spectrum.odd() + 20 * Spectrum.even(), rng=1)
    >>> field(np.zeros(3), np.zeros(3)).shape
    (2, 3)
    """
    if not isinstance(spectrum, Spectrum):
        spectrum = Spectrum.from_covariance(spectrum)
    if parity is not None:
        spectrum = spectrum.only(parity)
    modes = as_modes(lmax)
    sigma = np.sqrt(spectrum.variances(modes))
    return from_coefficients(Coefficients(modes, sigma * generator(rng).standard_normal(len(modes))))


@arguments.accepts(rng=arguments.seed)
def random_field(power: ArrayLike, rng: Rng) -> Signal:
    """A Gaussian random field with a given power of each degree, the same for T and S.

    Parameters
    ----------
    power : (lmax,) array
        ∫ |V_l|² dΩ of one kind, on average [(µas/yr)²]
    rng : Generator or int
        The source of all randomness.

    Raises
    ------
    ParameterError
        If the power is not one number of at least zero for each degree.
    """
    return systematics(Spectrum.given(power), rng, lmax=np.size(power))


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
    """
    return systematics(not_negative("omega", omega) * Spectrum.waves(hubble), rng, lmax=lmax)
