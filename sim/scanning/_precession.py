"""How the spin axis goes round the Sun: the law's two equations as integrals over one turn, in closed form.

The rate g(ν) = dν/dλ does not depend on λ, so that both equations are quadratures: λ = ∫ dν/g, and the slow part of
the spin's phase is −cos ξ ∫ dν − sin ξ ∫ sin ν dλ. Both integrands are smooth and periodic in ν; sums over even steps
of ν give their Fourier series, whose terms fall off as a power, to rounding.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray

#: Steps of ν in a turn: at the slowest speed, 1.5, a Fourier term of that order is 1e-53 of the first.
_STEPS = 256
_SLOWEST = 1.5


@dataclass(frozen=True)
class _Turning:
    """∫ f dν of a periodic f, from its values at even steps of ν: a slope, and a Fourier series."""

    slope: float
    terms: FloatArray

    @classmethod
    def of(cls, values: FloatArray) -> "_Turning":
        order = np.arange(1, len(values) // 2)
        waves = np.fft.rfft(values)[: len(order) + 1] / len(values)
        terms = 2 * waves[1:] / (1j * order)
        large = np.flatnonzero(np.abs(terms) > 1e-17 * abs(waves[0]))
        return cls(waves[0].real, terms[: large[-1] + 1 if len(large) else 0])

    def __call__(self, nu: Any) -> Any:
        wave, total = np.exp(1j * nu), np.zeros(np.shape(nu), complex)
        for term in self.terms[::-1]:
            total = (total + term) * wave
        return self.slope * nu + total.real


class Precession:
    """ν and the slow part of Ω as functions of the Sun's longitude λ (Lindegren & Bastian 2011, EAS 45, 109).

    Parameters
    ----------
    precessions : float
        Turns of the axis about the Sun while the Sun goes round once.
    xi : float
        Angle between the axis and the Sun. [rad]
    """

    def __init__(self, precessions: float, xi: float):
        nu = 2 * np.pi * np.arange(_STEPS) / _STEPS
        self.xi, self.speed = xi, _SLOWEST
        # The mean of 1/g falls with S and is convex: Newton's steps from below do not overshoot.
        for _ in range(100):
            rate = self.rate(nu)
            slope = self.speed / (np.sqrt(self.speed**2 - np.cos(nu) ** 2) * np.sin(xi))
            step = (np.mean(1 / rate) - 1 / precessions) / np.mean(slope / rate**2)
            if step < 0 and self.speed == _SLOWEST:
                raise ParameterError(
                    f"precessions must be at least {1 / np.mean(1 / rate):.3g} in a year at this solar_aspect, "
                    f"not {precessions}"
                )
            self.speed += step
            if abs(step) < 1e-15 * self.speed:
                break
        rate = self.rate(nu)
        self._longitude, self._sine = _Turning.of(1 / rate), _Turning.of(np.sin(nu) / rate)

    def rate(self, nu: FloatArray) -> FloatArray:
        """g = dν/dλ."""
        return (np.sqrt(self.speed**2 - np.cos(nu) ** 2) + np.cos(self.xi) * np.sin(nu)) / np.sin(self.xi)

    def phase(self, start: float, turned: FloatArray) -> FloatArray:
        """ν [rad] where it was `start`, and the Sun has since turned by so much, (n,). [rad]"""
        wanted = self._longitude(start) + turned
        nu = wanted / self._longitude.slope
        for _ in range(30):
            step = (wanted - self._longitude(nu)) * self.rate(nu)
            nu = nu + step
            if not np.any(np.abs(step) > 1e-13 * (1 + np.abs(nu))):
                break
        return nu

    def lag(self, start: float, nu: FloatArray) -> FloatArray:
        """What Ω lacks of an even turn while ν went from `start` to `nu`. [rad]"""
        return -np.cos(self.xi) * (nu - start) - np.sin(self.xi) * (self._sine(nu) - self._sine(start))
