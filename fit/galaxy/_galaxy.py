"""An acceleration in the axes of the Galaxy, and what it is compared with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.galaxy._relations import R0, circular_speed, distance_of_centre, expected_acceleration
from fit.quality import printed_p_value
from fit.storage import Result
from vsh.io import tables
from vsh.tools.arguments import number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray, Table
from vsh.tools.units import KM_S_MYR
from vsh.vector import Vector, probability_of

_NAMES = ("towards the centre", "along rotation", "towards the north pole")


@dataclass(frozen=True, eq=False, repr=False)
class GalacticOrbit(Result):
    """The acceleration of the Solar System, and the orbit that it belongs to.

    Attributes
    ----------
    acceleration : Vector
        In Galactic axes: towards the centre, along rotation, towards the north pole. [µas/yr]
    r0, r0_error : float
        The distance of the centre that a speed is computed with. [kpc]
    notes : tuple of str
    """

    acceleration: Vector
    r0: float
    r0_error: float
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        value, error = self.inward
        return f"<GalacticOrbit: {value:.3g} ± {error:.2g} µas/yr towards the centre>"

    @property
    def inward(self) -> tuple[float, float]:
        """The component towards the centre and its error; noise does not make it larger. [µas/yr]"""
        return float(self.acceleration.value[0]), float(self.acceleration.sigma[0])

    @property
    def amplitude_bias(self) -> float:
        """By how much noise makes the amplitude too large on average, to first order: (tr C − rᵀCr)/2a. [µas/yr]"""
        vector = self.acceleration
        along = vector.value / vector.amplitude
        return float((np.trace(vector.covariance) - along @ vector.covariance @ along) / (2 * vector.amplitude))

    @property
    def circular_speed(self) -> tuple[float, float]:
        """V0 = √(a R0) of the component towards the centre, and its error. [km/s]"""
        value, error = self._inward_seen()
        return circular_speed(value, error, self.r0, self.r0_error)

    @property
    def distance_of_centre(self) -> tuple[float, float]:
        """R0 = a/Ω0² with the motion of Sgr A*, and its error. [kpc]"""
        return distance_of_centre(*self._inward_seen())

    def _inward_seen(self) -> tuple[float, float]:
        value, error = self.inward
        if not value > 0:
            raise ParameterError(
                f"this acceleration does not point to the centre ({value:.3g} ± {error:.2g} µas/yr towards it): no "
                "orbit"
            )
        return value, error

    @property
    def across_p_value(self) -> float:
        """Probability of as much along rotation and north from noise alone, with the component inward as it is."""
        values, covariance = self.acceleration.value[1:], self.acceleration.covariance[1:, 1:]
        return probability_of(float(values @ np.linalg.solve(covariance, values)), 2, self.acceleration.dof)

    def compared(self, potential: Callable[[FloatArray], Any], *, height: float = 0.021) -> tuple[Vector, float]:
        """An acceleration from a model of the Galaxy, and how probable ours is in its light.

        Parameters
        ----------
        potential : function of a position
            From galactocentric x, y, z [kpc; the Sun at (−R0, 0, height), x towards the centre, y along rotation] to an
            acceleration along the same axes, (3,) [km/s/Myr, or a Quantity of any acceleration]. Of gala it is
            ``lambda x: potential.acceleration(x * u.kpc)``; of galpy (fr x/R, fr y/R, fz) of `evaluateRforces` and
            `evaluatezforces` at R = hypot(x, y), in km/s/Myr.
        height : float
            Height of the Sun above the plane. [kpc]

        Returns
        -------
        expected : Vector
            Without errors, along the Galactic axes. [µas/yr]
        p_value : float
            Probability of a difference as large as ours or larger.

        Raises
        ------
        ParameterError
            If the function does not give three finite numbers.
        """
        if not callable(potential):
            raise ParameterError(f"potential is a function of a position, not {type(potential).__name__}")
        force = potential(np.array([-self.r0, 0.0, number("height", height)]))
        if hasattr(force, "to_value"):
            try:
                force = force.to_value("km / (s Myr)")
            except (ValueError, TypeError) as error:  # astropy's UnitConversionError is one
                raise ParameterError(f"the potential gives no acceleration: {error}") from None
        force = np.asarray(force, float).ravel()
        if force.shape != (3,) or not np.isfinite(force).all():
            raise ParameterError(f"the potential must give three finite components of an acceleration, not {force}")
        expected = force * KM_S_MYR
        away = replace(self.acceleration, value=self.acceleration.value - expected)
        return Vector(expected, np.zeros((3, 3)), "galactic"), away.p_value

    def report(self) -> str:
        """The orbit as text."""
        vector = self.acceleration
        lines = ["Acceleration of the Solar System in the Galaxy [µas/yr]"]
        lines += [
            f"  {name:24}{v:+.3f} ± {s:.3f}" for name, v, s in zip(_NAMES, vector.value, vector.sigma, strict=True)
        ]
        lines.append(
            f"  amplitude               {vector.amplitude:.3f} ± {vector.amplitude_error:.3f}, on average "
            f"{self.amplitude_bias:.3f} too large"
        )
        lines.append(
            f"  along rotation and north: p = {printed_p_value(self.across_p_value)} of as much from noise alone"
        )
        if self.inward[0] > 0:
            speed, centre = self.circular_speed, self.distance_of_centre
            lines += [
                (
                    f"circular speed          {speed[0]:.1f} ± {speed[1]:.1f} km/s with R0 = {self.r0:g} ± "
                    f"{self.r0_error:g} kpc"
                ),
                (
                    f"distance of the centre  {centre[0]:.2f} ± {centre[1]:.2f} kpc with the motion of Sgr A*, no R0 "
                    "assumed"
                ),
                (
                    f"expected inward         {expected_acceleration(self.r0):.3f} µas/yr with that motion and R0 = "
                    f"{self.r0:g} kpc"
                ),
            ]
        else:
            lines.append("it does not point to the centre: no circular speed, no distance")
        return "\n".join([*lines, *(f"  - {note}" for note in self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each component, as an astropy Table."""
        columns = {"component": list(_NAMES), "value": self.acceleration.value, "sigma": self.acceleration.sigma}
        return tables.table_of(columns, {"frame": "galactic"}, dict.fromkeys(("value", "sigma"), "uas / yr"))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The components, with what is expected, on matplotlib axes."""

        from fit.galaxy._plot import plot_orbit

        return plot_orbit(self, ax=ax)


def orbit(acceleration: Any, *, r0: float = R0[0], r0_error: float = R0[1]) -> GalacticOrbit:
    """What an acceleration says of our orbit in the Galaxy.

    Parameters
    ----------
    acceleration : Solution, or Vector
        A solution for spin and acceleration, by harmonics or the frame solver; or the acceleration. [µas/yr]
    r0, r0_error : float
        Distance of the Galactic centre. [kpc]

    Raises
    ------
    ParameterError
        If it is neither, or R0 is not above zero.

    Notes
    -----
    Gaia Collaboration, Klioner et al. (2021, A&A 649, A9), Bovy (2020, arXiv:2012.02169). The Galaxy's companions add
    to the acceleration (`sim.effects.attractions`): the LMC today's 0.18 µas/yr, which no error here holds.
    """
    vector = getattr(acceleration, "acceleration", acceleration)
    if not isinstance(vector, Vector):
        raise ParameterError(
            "an orbit follows from a solution with an acceleration, or from a Vector, not a "
            f"{type(acceleration).__name__}"
        )
    if vector.unit != "µas/yr":
        raise ParameterError(f"an acceleration in µas/yr is wanted, not in {vector.unit}")
    error = number("r0_error", r0_error)
    notes = tuple(map(str, getattr(acceleration, "notes", ())))
    return GalacticOrbit(vector.to_frame("galactic"), positive("r0", r0), abs(error), notes)
