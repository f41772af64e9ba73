"""Random fields by their spectrum: the mean power of each kind and degree.

How motions at an angle θ are correlated: Wigner's functions of spin 1, and functions that were published.

Two motions are compared by carrying one along the great circle to the other. The components along and across it give
ξ± = ⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩, and

    ξ+ = Σ (P_T + P_S)_l d⁺_l/4π,   ξ− = Σ (P_T − P_S)_l d⁻_l/4π.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.arguments import float_array
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, FloatArray, IntArray
from vsh.tools.units import hubble_rate

#: Panels of 16 nodes in the integral over θ, at least, and the power by which they crowd towards zero.
_PANELS, _GRADING = 250, 3


def d_plus(lmax: int, theta: ArrayLike) -> FloatArray:
    """d⁺_l = d^l_{11}(θ) = ½ (1 + x) P^{(0,2)}_{l−1}(x), x = cos θ, for l = 1 … lmax."""
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
    """d⁻_l = ½ (1 − x) P^{(2,0)}_{l−1}(x) = (−1)^{l−1} d⁺_l(π − θ) for l = 1 … lmax."""
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


@arguments.explained
def VASILIEV_BAUMGARDT_2021(theta: ArrayLike) -> FloatArray:
    """V(θ) of Gaia EDR3: 400/(1 + θ/0.3°) + 300 exp(−θ/12°). [(µas/yr)²]

    Notes
    -----
    Vasiliev & Baumgardt (2021, MNRAS 505, 5978). Taken literally it exceeds what quasars show at low degrees a few
    times: simulate with it, and estimate low degrees from the data (`fit.background.floor`).
    """
    degrees = np.degrees(theta)
    return 400 / (1 + degrees / 0.3) + 300 * np.exp(-degrees / 12)


@arguments.explained
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


def wave_fractions(lmax: int) -> FloatArray:
    """Share of each degree in the power of a stochastic gravitational-wave background, (lmax,).

    α_l = 24 (2l + 1) / [(l − 1) l² (l + 1)² (l + 2)]: 5/6, 7/60, 3/100, … from l = 2 on; they
    sum to 1. The fractions are those of Book & Flanagan (2011, PhRvD 83, 024024), table 1.
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


#: The two parities, by what the field at the antipode is.
PARITIES = ("odd", "even")


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum(InNotebook):
    """The mean power of a statistically isotropic field in each kind and degree, for an amplitude of one.

    Spectra add, and are multiplied by numbers.

    Attributes
    ----------
    name : str
        For reports.
    law : function
        From lmax to the powers ∫ |V_l|² dΩ of T and S in degrees 1 … lmax, (2, lmax). [(µas/yr)²]

    Examples
    --------
    >>> Spectrum.waves(hubble=70).power(3).round(2)
    array([[   0.  , 1141.7 ,  159.84],
           [   0.  , 1141.7 ,  159.84]])
    >>> (2 * Spectrum.odd()).power(2)
    array([[ 6.,  0.],
           [ 0., 10.]])
    """

    name: str
    law: Callable[[int], FloatArray]

    def __repr__(self) -> str:
        return f"<Spectrum: {self.name}>"

    @classmethod
    def waves(cls, hubble: float = 70.0) -> Spectrum:
        """Gravitational waves longer than the observations; amplitude Ω_GW, H0 = `hubble` = 70 h70² Ω_GW. [km/s/Mpc]

        Notes
        -----
        Book & Flanagan (2011, PhRvD 83, 024024): 4π H0² α_l, half of it toroidal.
        """
        whole = 4 * np.pi * hubble_rate(arguments.positive("hubble", hubble)) ** 2
        return cls(
            f"gravitational waves, H0 = {hubble:g} km/s/Mpc", lambda lmax: both(whole * wave_fractions(lmax) / 2)
        )

    @classmethod
    def flat(cls) -> Spectrum:
        """One power for each mode, of whatever degree: P_l = 2l + 1 in each kind."""
        return cls("flat", lambda lmax: both(2 * np.arange(1.0, lmax + 1) + 1))

    @classmethod
    def odd(cls) -> Spectrum:
        """One power for each mode of the fields that a spin belongs to: T of odd degrees, S of even ones."""
        return replace(cls.flat().only("odd"), name="odd parity")

    @classmethod
    def even(cls) -> Spectrum:
        """One power for each mode of the fields that a glide belongs to: S of odd degrees, T of even ones."""
        return replace(cls.flat().only("even"), name="even parity")

    @classmethod
    def power_law(cls, index: float) -> Spectrum:
        """P_l = l^`index` in each kind; 0 for the same power in every degree."""
        index = arguments.number("index", index)
        return cls(f"power law l^{index:g}", lambda lmax: both(np.arange(1.0, lmax + 1) ** index))

    @classmethod
    def given(cls, toroidal: ArrayLike, spheroidal: ArrayLike | None = None, name: str = "given") -> Spectrum:
        """Powers of degrees 1, 2, … as they are given.

        Parameters
        ----------
        toroidal : (lmax,) array
            P_T. [(µas/yr)²]
        spheroidal : (lmax,) array, optional
            P_S; the same as P_T unless given. [(µas/yr)²]
        name : str
            For reports.

        Raises
        ------
        ParameterError
            If they are not one number of at least zero for each degree.
        """
        toroidal = float_array("toroidal", toroidal)
        both = np.stack(
            [toroidal, toroidal if spheroidal is None else float_array("spheroidal", spheroidal, toroidal.shape)]
        )
        if both.ndim != 2 or not both.shape[1] or (both < 0).any():
            raise ParameterError("a spectrum is one power of at least zero for each degree from 1 on")
        return cls(name, lambda lmax: cut(both, lmax, name))

    @classmethod
    def from_covariance(cls, function: Callable[[FloatArray], FloatArray], name: str | None = None) -> Spectrum:
        """The spectrum of a field whose motions are correlated by V(θ), carried along great circles; P_T = P_S.

        Parameters
        ----------
        function : function of θ [rad]
            V = ½ ξ+, asked once for each number of degrees. [(µas/yr)²]
        name : str, optional
            For reports.

        Raises
        ------
        ParameterError
            If V is no function, or the power of a degree comes out negative: no field has such a covariance.

        Notes
        -----
        P_l = 2π (2l + 1) ∫ V d⁺_l sin θ dθ. A published V is often measured as ½⟨µ_α*µ_α*' + µ_δµ_δ'⟩ in local
        axes, which is the same below some 20°, and not near the poles.

        Examples
        --------
        >>> from vsh.models.covariance import LINDEGREN_2021
        >>> Spectrum.from_covariance(LINDEGREN_2021).power(5)[0].round(1)
        array([218.3, 291.2, 306.9, 288.8, 257. ])
        """
        values_of(function, np.array([0.1, 1.0]))
        name = name or f"of the covariance function {getattr(function, '__name__', 'V(θ)')}"
        integrals = lru_cache(maxsize=16)(lambda lmax: without_rounding(power_of(function, lmax)))
        return cls(name, lambda lmax: both(integrals(lmax)))

    def only(self, parity: str) -> Spectrum:
        """The part of it that is odd, as a spin is, or even, as a glide is.

        Parameters
        ----------
        parity : {"odd", "even"}
            Odd: T of odd degrees and S of even ones.
        """
        arguments.choice("parity", parity, PARITIES)
        return Spectrum(
            f"{self.name}, {parity} parity", lambda lmax: self.law(lmax) * (is_odd(lmax) == (parity == "odd"))
        )

    def power(self, lmax: int) -> FloatArray:
        """∫ |V_l|² dΩ of T and S for l = 1 … `lmax`, (2, lmax). [(µas/yr)²]

        Raises
        ------
        ParameterError
            If a power is negative.
        ModesError
            If it was given to a lower degree.
        """
        lmax = as_modes(lmax).lmax
        powers = float_array(f"the spectrum {self.name}", self.law(lmax), (2, lmax))
        if (powers < 0).any():
            kind, degree = np.argwhere(powers < 0)[0]
            raise ParameterError(
                f"the power of {'TS'[kind]}{degree + 1} is {powers[kind, degree]:.3g} in the spectrum "
                f"{self.name}: no field has a negative power"
            )
        return powers

    def variances(self, modes: Modes | int) -> FloatArray:
        """Variance of each of `modes`, (p,): P_l/(2l + 1), half where a mode stands for ±m. [(µas/yr)²]"""
        modes = as_modes(modes)
        l = modes.degrees
        kind = np.repeat([0, 1], len(modes) // 2)
        return self.power(modes.lmax)[kind, l - 1] / (2 * l + 1) / modes.norm2

    def covariance(self, theta: ArrayLike, lmax: int = 400) -> FloatArray:
        """V(θ) = ½ ξ+ = Σ ½ (P_T + P_S) d⁺_l/4π, of the shape of θ. [(µas/yr)²]

        Parameters
        ----------
        theta : array
            Angles. [rad]
        lmax : int
            The highest degree of the sum.
        """
        sums = self.power(lmax).mean(0) @ d_plus(lmax, np.ravel(theta)) / (4 * np.pi)
        return sums.reshape(np.shape(theta))

    @property
    def spin_error(self) -> float:
        """How large a spin such a field has in each component: √(P_T1/8π). [µas/yr]"""
        return float(np.sqrt(self.power(1)[0, 0] / (8 * np.pi)))

    @property
    def acceleration_error(self) -> float:
        """How large a glide such a field has in each component: √(P_S1/8π). [µas/yr]"""
        return float(np.sqrt(self.power(1)[1, 0] / (8 * np.pi)))

    def __add__(self, other: Any) -> Spectrum:
        if not isinstance(other, Spectrum):
            return NotImplemented
        return Spectrum(f"{self.name} + {other.name}", lambda lmax: self.law(lmax) + other.law(lmax))

    def __mul__(self, factor: float) -> Spectrum:
        factor = arguments.not_negative("the factor on a spectrum", factor)
        return Spectrum(f"{factor:g} × {self.name}", lambda lmax: factor * self.law(lmax))

    __rmul__ = __mul__
