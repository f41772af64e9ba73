"""Velocities in linear theory: one Gaussian field, whose power follows from that of matter.

The velocity is the gradient of a potential, v(k) = i f H δ(k) k/k², with f the growth rate. In units of h the Hubble
constant is 100 km/s per Mpc/h. Velocities at a separation r are correlated by Ψ∥ along r and Ψ⊥ across it (Górski 1988,
ApJ 332, L7):

    Ψ⊥(r) = (f H)²/(2π²) ∫ P(k) j₁(kr)/(kr) dk,   Ψ∥(r) = (f H)²/(2π²) ∫ P(k) [j₀(kr) − 2 j₁(kr)/(kr)] dk.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.special import spherical_jn

from vsh.checks.arguments import positive
from vsh.checks.arrays import float_array
from vsh.checks.frozen import Frozen
from vsh.checks.types import ArrayLike, FloatArray
from vsh.errors import ParameterError

#: The Hubble constant where distances are in Mpc/h. [km/s per Mpc/h]
HUBBLE = 100.0
#: Separations beyond which velocities are taken as independent. [Mpc/h]
_FARTHEST = 3000.0


@dataclass(frozen=True, eq=False, repr=False)
class LinearTheory(Frozen):
    """A power spectrum of matter today and the rate at which structures grow.

    Attributes
    ----------
    k : (n,) array
        Wave numbers, rising. [h/Mpc]
    power : (n,) array
        P(k). [(Mpc/h)³]
    growth_rate : float
        f = d ln D/d ln a today; Ω_m^0.55 in general relativity.
    name : str
        For reports.

    Raises
    ------
    ParameterError
        If wave numbers do not rise from above zero, or a power is not above zero.
    """

    k: FloatArray
    power: FloatArray
    growth_rate: float
    name: str = "linear theory"

    def __post_init__(self) -> None:
        k, power = float_array("k", self.k), float_array("power", self.power)
        if k.ndim != 1 or k.shape != power.shape or k.size < 8 or not (k[0] > 0 and (np.diff(k) > 0).all()):
            raise ParameterError(
                "a power spectrum is two arrays of one length, eight at least; k rises from above zero"
            )
        if not (power > 0).all():
            raise ParameterError("the power of matter is above zero at every wave number")
        object.__setattr__(self, "k", k)
        object.__setattr__(self, "power", power)
        object.__setattr__(self, "growth_rate", positive("growth_rate", self.growth_rate))
        super().__post_init__()

    def __repr__(self) -> str:
        return f"<LinearTheory: {self.name}, {self.sigma:.0f} km/s in each component>"

    def power_at(self, k: ArrayLike) -> FloatArray:
        """P(k) between the tabulated wave numbers; nothing beyond them. [(Mpc/h)³]

        Parameters
        ----------
        k : array
            [h/Mpc]
        """
        k = np.asarray(k, float)
        inside = (k >= self.k[0]) & (k <= self.k[-1])
        return np.where(inside, np.exp(self._spline(np.log(np.clip(k, self.k[0], self.k[-1])))), 0.0)

    @property
    def sigma(self) -> float:
        """The dispersion of velocities in each component. [km/s]"""
        return float(np.sqrt(self._correlations[1][0, 0]))

    def correlation(self, separation: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Ψ∥ and Ψ⊥, the correlations of velocities along a separation and across it. [(km/s)²]

        Parameters
        ----------
        separation : array
            [Mpc/h]

        Returns
        -------
        tuple[array, array]
        """
        separation = np.asarray(separation, float)
        near = separation < _FARTHEST
        x = np.arcsinh(np.minimum(separation, _FARTHEST))
        along, across = np.moveaxis(self._correlations[0](x), -1, 0)
        return np.where(near, along, 0.0), np.where(near, across, 0.0)

    def covariance(self, positions: FloatArray) -> FloatArray:
        """The covariance of the velocities at places, (3n, 3n), place by place: x, y, z of the first, … [(km/s)²]

        Parameters
        ----------
        positions : (3, n) array
            [Mpc/h]
        """
        n = positions.shape[1]
        apart = positions[:, :, None] - positions[:, None, :]
        r = np.sqrt(np.sum(apart * apart, 0))
        along, across = self.correlation(r)
        unit = apart / np.maximum(r, 1e-12)
        out = np.empty((n, 3, n, 3))
        for i in range(3):
            for j in range(3):
                out[:, i, :, j] = (along - across) * unit[i] * unit[j] + (across if i == j else 0.0)
        return out.reshape(3 * n, 3 * n)

    def bulk_flow(self, radius: float) -> float:
        """The rms speed of the mean velocity within a sphere. [km/s]

        Parameters
        ----------
        radius : float
            Of the sphere, whose edge is sharp. [Mpc/h]

        Examples
        --------
        >>> [round(PLANCK_2018.bulk_flow(radius)) for radius in (20, 45, 100)]
        [406, 316, 215]
        """
        k, log_step = self._fine
        x = k * positive("radius", radius)
        window = 3 * spherical_jn(1, x) / x
        return float(np.sqrt(self._scale * np.sum(self.power_at(k) * window**2 * k) * log_step))

    @property
    def _scale(self):
        return (self.growth_rate * HUBBLE) ** 2 / (2 * np.pi**2)

    @cached_property
    def _fine(self):
        """Wave numbers close enough for sums, and their step in ln k."""
        log_k, step = np.linspace(np.log(self.k[0]), np.log(self.k[-1]), 6001, retstep=True)
        return np.exp(log_k), step

    @cached_property
    def _spline(self):
        return make_interp_spline(np.log(self.k), np.log(self.power))

    @cached_property
    def _correlations(self):
        """Ψ∥ and Ψ⊥ as a spline in arsinh r, and as a table."""
        k, step = self._fine
        weight = self._scale * self.power_at(k) * k * step
        x = np.linspace(0, np.arcsinh(_FARTHEST), 500)
        table = np.empty((len(x), 2))
        for i, r in enumerate(np.sinh(x)):
            # j_0(x) and j_1(x)/x, three times as fast as the library's by recurrence.
            kr = np.maximum(k * r, 1e-6)
            square, zeroth = kr * kr, np.sin(kr) / kr
            over = np.where(kr < 0.02, 1 / 3 - square / 30 + square**2 / 840, (zeroth - np.cos(kr)) / square)
            table[i] = weight @ (zeroth - 2 * over), weight @ over
        return make_interp_spline(x, table), table


def _planck() -> LinearTheory:
    with (Path(__file__).parent / "planck2018_power.txt").open(encoding="utf-8") as file:
        k, power = np.loadtxt(file, unpack=True)
    return LinearTheory(k, power, 0.3111**0.55, "linear ΛCDM, Planck 2018")


#: Flat, Ω_m = 0.3111, σ_8 = 0.8102: Planck Collaboration (2020, A&A 641, A6), with f = Ω_m^0.55.
PLANCK_2018 = _planck()
