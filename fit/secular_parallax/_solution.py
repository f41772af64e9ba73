"""Our velocity or the Hubble constant as a least-squares fit found them, with the acceleration."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtri

from fit.named import NamedSolution
from fit.secular_parallax._dispersion import Preferred
from fit.secular_parallax._flow import Flow
from fit.secular_parallax._report import text_of
from vsh import Coefficients
from vsh.field import Field
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, transverse_distance
from vsh.sky.sphere import triad
from vsh.tools.types import FloatArray, Table
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class ParallaxSolution(NamedSolution):
    """What both fits have in common.

    Attributes
    ----------
    names : tuple of str
        v_x v_y v_z, or H0; a_x a_y a_z; omega_x … where the spin is free.
    values : (p,) array
        [km/s, or km/s/Mpc; µas/yr]
    covariance : (p, p) array
    chi2 : float
    n_data : int
        Two a source.
    frame : str
        Frame of the axes.
    peculiar_dispersion : float
        The dispersion of peculiar velocities in each component, beside the flow, in the weights. [km/s]
    flow : Flow or None
        The velocities that galaxies share, as far as they were fitted.
    noise_covariance : (p, p) array or None
        The covariance were the flow known.
    flow_covariance : (p, p) array or None
        What the flow of linear theory would add to the covariance, where it was left out (flows=None) and galaxies are
        near enough for one.
    preferred : Preferred or None
        What the residuals say of the dispersion; None for catalogues in parts.
    notes : tuple of str
    """

    peculiar_dispersion: float = 750.0
    flow: Flow | None = None
    noise_covariance: FloatArray | None = None
    flow_covariance: FloatArray | None = None
    preferred: Preferred | None = None

    @property
    def cosmic_share(self) -> float | None:
        """Which share of the variance of v, or of H0, is by flows that galaxies share; None where none were fitted."""
        if self.flow is None or self.noise_covariance is None:
            return None
        size = 3 if self.names[0] == "v_x" else 1
        return float(1 - np.trace(self.noise_covariance[:size, :size]) / np.trace(self.covariance[:size, :size]))

    def to_table(self) -> Table:
        """Parameters with their errors, units and correlations as an astropy Table, a row each; tests in its meta."""
        table = super().to_table()
        table.meta |= self._tests() | {"n_sources": self.n_sources, "chi2": self.chi2, "dof": self.dof}
        units = {"v": "km / s", "H0": "km / (s Mpc)"}
        table.add_column([units.get(name.partition("_")[0], "uas / yr") for name in self.names], 3, "unit")
        return table

    def report(self, *, source: str | None = None, truth: dict[str, Any] | None = None, long: bool = False) -> str:
        """The result as text.

        Parameters
        ----------
        source : str, optional
            What was fitted.
        truth : dict, optional
            "velocity" and "hubble" of a simulated catalogue, printed beside what was found.
        long : bool
            Add the dispersion, tests against none and against the microwave background, and correlations.
        """
        return text_of(self, source, truth, long)

    def _tests(self):
        """p-values and limits by name."""
        return {}

    def _motions(self, field, velocity, hubble):
        """What a velocity and H0 predict, with acceleration and spin, (2, n)."""
        p, q, _ = triad(field.lon, field.lat)
        rate = 1 / (AU_PER_YEAR * transverse_distance(field.redshift, None, hubble=hubble))
        spin = self.spin
        vectors = Coefficients.from_vectors(np.zeros(3) if spin is None else spin.value, self.acceleration.value)
        return vectors.at(field.lon, field.lat) - np.stack([velocity @ p, velocity @ q]) * rate


@dataclass(frozen=True, eq=False)
class VelocitySolution(ParallaxSolution):
    """Our velocity, for the Hubble constant in `assumed_hubble`. [km/s/Mpc]"""

    assumed_hubble: float = float("nan")

    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a `field`, (2, n). [µas/yr]

        With the default cosmology's shape of the distance; a spin that was held fixed is not in it.
        """
        return self._motions(field, self.velocity.value, self.assumed_hubble)

    @property
    def velocity(self) -> Vector:
        """v, a Vector in km/s, toward the apex."""
        return self._vector("v", "km/s")

    @property
    def apex(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Galactic longitude and latitude of the apex, and their errors: two pairs. [deg]"""
        galactic = self.velocity.to_frame("galactic")
        return galactic.direction, galactic.direction_error

    def _tests(self):
        return {
            "assumed_hubble": self.assumed_hubble,
            "p_value_zero": self.velocity.p_value,
            "p_value_microwave_background": self.against()[1],
        }

    def against(self, velocity: Vector = CMB_VELOCITY_PLANCK18) -> tuple[float, float]:
        """χ² of the difference from another `velocity` [km/s] (its own errors included), and its p-value."""
        return _difference(self.velocity, velocity)


@dataclass(frozen=True, eq=False)
class HubbleSolution(ParallaxSolution):
    """The Hubble constant, for the velocity in `assumed_velocity` (a Vector, km/s)."""

    assumed_velocity: Vector = CMB_VELOCITY_PLANCK18

    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a `field`, (2, n). [µas/yr]

        With the default cosmology's shape of the distance; a spin that was held fixed is not in it.
        """
        return self._motions(field, self.assumed_velocity.to_frame(self.frame).value, self.hubble)

    @property
    def hubble(self) -> float:
        """H0. [km/s/Mpc]"""
        return float(self.values[0])

    @property
    def hubble_error(self) -> float:
        """Its standard error; that of the velocity included. [km/s/Mpc]"""
        return float(self.sigma[0])

    @property
    def hubble_limits(self) -> tuple[float, float]:
        """Limits from below and from above, 95 % each, zero where they are negative. [km/s/Mpc]"""
        low, high = (max(self.hubble + float(ndtri(p)) * self.hubble_error, 0.0) for p in (0.05, 0.95))
        return low, high

    def _tests(self):
        low, high = self.hubble_limits
        limits = {"hubble_above_95": low} if low > 0 else {}
        return {"assumed_velocity": self.assumed_velocity.amplitude, **limits, "hubble_below_95": high}


def _difference(a, b):
    b = b.to_frame(a.frame)
    away = a.value - b.value
    chi2 = float(away @ np.linalg.solve(a.covariance + b.covariance, away))
    return chi2, float(chdtrc(3, chi2))
