"""What the acceleration of the Solar System says of our Galaxy: circular speed, distance of its centre, potentials.

On a circular orbit acceleration, speed and radius follow any one of them from two.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Section
from vsh.tools.arguments import float_array, not_negative, number, positive
from vsh.tools.digits import format_p_value, format_with_error
from vsh.tools.errors import ParameterError
from vsh.tools.types import Axes, FloatArray, Table
from vsh.tools.units import AU_PER_YEAR, JULIAN_YEAR, KM_S_MYR
from vsh.vector import Vector, chance_probability

__all__ = ["R0", "GalacticOrbit", "circular_speed", "distance_of_centre", "expected_acceleration", "orbit"]


#: Distance of the Galactic centre and its error [kpc]: GRAVITY Collaboration (2021, A&A 647, A59), with systematics.
R0 = (8.275, 0.034)
#: Motion of Sgr A* along Galactic longitude, towards lower ones, and its error [mas/yr]: Reid & Brunthaler (2020, ApJ
#: 892, 39).
SGR_A = (6.411, 0.008)
#: The Sun's own speed along Galactic rotation [km/s]: Schönrich, Binney & Dehnen (2010, MNRAS 403, 1829), 12.24 ± 0.47
#: with systematics of 2.
SOLAR_SPEED = 12.24
SOLAR_SPEED_ERROR = 2.1
#: By which that speed is divided. [kpc]
_R0_OF_SPEED = 8.178
#: (km/s)²/kpc in km/s/Myr.
_KM2_S2_KPC = 1e6 * JULIAN_YEAR / 3.0856775814913673e16


def _compute_speed2_over_radius(acceleration):
    """Compute V²/R of an apparent acceleration. [(km/s)²/kpc]"""
    return acceleration / (KM_S_MYR * _KM2_S2_KPC)


def circular_speed(
    acceleration: float, acceleration_error: float = 0.0, r0: float = R0[0], r0_error: float = 0.0
) -> tuple[float, float]:
    """V0 = √(a R0), and its error.

    Parameters
    ----------
    acceleration, acceleration_error : float
        Towards the centre. [µas/yr]
    r0, r0_error : float
        Distance of the centre; `R0` has its error. [kpc]

    Returns
    -------
    tuple of float
        [km/s]

    Examples
    --------
    >>> "{:.1f} ± {:.1f}".format(*circular_speed(5.05, 0.35))
    '243.7 ± 8.4'
    """
    acceleration, r0 = positive("acceleration", acceleration), positive("r0", r0)
    errors = not_negative("acceleration_error", acceleration_error), not_negative("r0_error", r0_error)
    speed = np.sqrt(_compute_speed2_over_radius(acceleration) * r0)
    return float(speed), float(speed / 2 * np.hypot(errors[0] / acceleration, errors[1] / r0))


def angular_speed(motion: float = SGR_A[0], solar_speed: float = SOLAR_SPEED, r0: float = _R0_OF_SPEED) -> float:
    """Ω0 = V0/R0, from the motion of Sgr A*, which is at rest in the centre, less that of the Sun's own speed."""
    return number("motion", motion) * AU_PER_YEAR - number("solar_speed", solar_speed) / positive("r0", r0)


def angular_speed_error() -> float:
    """The error of `angular_speed`: of the motion of Sgr A* and of the Sun's own speed. [km/s/kpc]"""
    return float(np.hypot(SGR_A[1] * AU_PER_YEAR, SOLAR_SPEED_ERROR / _R0_OF_SPEED))


def distance_of_centre(
    acceleration: float, acceleration_error: float = 0.0, speed: float | None = None, speed_error: float | None = None
) -> tuple[float, float]:
    """R0 = a/Ω0², and its error: no distance goes in, but for the one by which the Sun's own speed is divided in Ω0.

    Parameters
    ----------
    acceleration, acceleration_error : float
        Towards the centre. [µas/yr]
    speed, speed_error : float
        Ω0 and its error, `angular_speed()` and `angular_speed_error()` unless given: the motion of Sgr A* less the
        Sun's own speed over R0, whose ± 2.1 km/s make ± 0.26 km/s/kpc. That R0 is 8.178 kpc; 5 % more of it change the
        result by half a per cent. [km/s/kpc]

    Returns
    -------
    tuple of float
        [kpc]

    Examples
    --------
    >>> "{:.2f} ± {:.2f}".format(*distance_of_centre(5.05, 0.35))
    '8.60 ± 0.62'
    """
    acceleration = positive("acceleration", acceleration)
    if speed_error is None:
        speed_error = angular_speed_error() if speed is None else 0.0
    speed = angular_speed() if speed is None else positive("speed", speed)
    errors = not_negative("acceleration_error", acceleration_error), not_negative("speed_error", speed_error)
    distance = _compute_speed2_over_radius(acceleration) / speed**2
    return float(distance), float(distance * np.hypot(errors[0] / acceleration, 2 * errors[1] / speed))


def expected_acceleration(r0: float = R0[0], speed: float | None = None) -> float:
    """a = Ω0² R0. [µas/yr]

    Parameters
    ----------
    r0 : float
        Distance of the centre. [kpc]
    speed : float, optional
        Ω0, `angular_speed()` unless given. [km/s/kpc]

    Examples
    --------
    >>> round(expected_acceleration(8.178), 3)
    4.804
    """
    speed = angular_speed() if speed is None else positive("speed", speed)
    return float(speed**2 * positive("r0", r0) * KM_S_MYR * _KM2_S2_KPC)


_AXIS_NAMES = ("towards the centre", "along rotation", "towards the north pole")


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
        return f"<GalacticOrbit: {format_with_error(*self.inward)} µas/yr towards the centre>"

    @property
    def inward(self) -> tuple[float, float]:
        """The component towards the centre and its error; noise does not make it larger. [µas/yr]"""
        return float(self.acceleration.value[0]), float(self.acceleration.sigma[0])

    @property
    def amplitude_bias(self) -> float:
        """Bias of the amplitude by noise, to first order: (tr C − rᵀCr)/2a. [µas/yr]"""
        vector = self.acceleration
        direction = vector.value / vector.amplitude
        return float((np.trace(vector.covariance) - direction @ vector.covariance @ direction) / (2 * vector.amplitude))

    @property
    def circular_speed(self) -> tuple[float, float]:
        """V0 = √(a R0) of the component towards the centre, and its error. [km/s]"""
        value, error = self._require_inward_component()
        return circular_speed(value, error, self.r0, self.r0_error)

    @property
    def distance_of_centre(self) -> tuple[float, float]:
        """R0 = a/Ω0² with the motion of Sgr A*, and its error. [kpc]"""
        return distance_of_centre(*self._require_inward_component())

    def _require_inward_component(self) -> tuple[float, float]:
        value, error = self.inward
        if not value > 0:
            raise ParameterError(
                f"this acceleration does not point to the centre ({format_with_error(value, error)} µas/yr towards "
                "it): no orbit"
            )
        return value, error

    @property
    def across_p_value(self) -> float:
        """Probability of as much along rotation and north from noise alone, with the component inward as it is."""
        values, covariance = self.acceleration.value[1:], self.acceleration.covariance[1:, 1:]
        return chance_probability(float(values @ np.linalg.solve(covariance, values)), 2, self.acceleration.dof)

    def compare_with(self, acceleration: Callable[[FloatArray], Any], *, height: float = 0.021) -> tuple[Vector, float]:
        """Compare with a model of the Galaxy: the acceleration by it, and how probable ours is in its light.

        Parameters
        ----------
        acceleration : function of a position
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
        if not callable(acceleration):
            raise ParameterError(f"acceleration is a function of a position, not {type(acceleration).__name__}")
        components = np.ravel(acceleration(np.array([-self.r0, 0.0, number("height", height)])))
        prediction = float_array("acceleration", components, (3,), unit="km / (s Myr)") * KM_S_MYR
        residual = replace(self.acceleration, value=self.acceleration.value - prediction)
        return Vector(prediction, np.zeros((3, 3)), "galactic"), residual.p_value

    def _sections(self, long):
        vector, remarks = self.acceleration, []
        amplitude = format_with_error(vector.amplitude, vector.amplitude_error)
        p_value = format_p_value(self.across_p_value)
        facts = [
            ("amplitude", f"{amplitude} µas/yr, on average {self.amplitude_bias:.3f} too large"),
            ("across", f"p = {p_value} of as much along rotation and north from noise alone"),
        ]
        if self.inward[0] > 0:
            speed, centre, prediction = self.circular_speed, self.distance_of_centre, expected_acceleration(self.r0)
            r0 = f"R0 = {self.r0:g} ± {self.r0_error:g} kpc"
            facts += [
                ("circular speed", f"{format_with_error(*speed)} km/s with {r0}"),
                ("centre", f"{format_with_error(*centre)} kpc away by the motion of Sgr A*, no R0 assumed"),
                ("expected", f"{prediction:.3f} µas/yr inward with that motion and R0 = {self.r0:g} kpc"),
            ]
        else:
            remarks.append("It does not point to the centre: no circular speed, no distance.")
        title = "Acceleration of the Solar System in the Galaxy"
        return (Section(title, facts, self.to_table(), remarks=remarks, notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each component, as an astropy Table."""
        columns = {"component": list(_AXIS_NAMES), "value": self.acceleration.value, "sigma": self.acceleration.sigma}
        return tables.table_of(columns, {"frame": "galactic"}, dict.fromkeys(("value", "sigma"), "uas / yr"))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The components, with what is expected, on matplotlib axes."""

        from fit.motions.figures import plot_orbit

        return plot_orbit(self, expected_acceleration(self.r0), ax=ax)


def orbit(acceleration: Any, *, r0: float = R0[0], r0_error: float = R0[1]) -> GalacticOrbit:
    """Derive our orbit in the Galaxy from an acceleration.

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
    to the acceleration (papers/bachchan2016/effects.py): the LMC 0.18 µas/yr today, which no error here holds.
    """
    vector = getattr(acceleration, "acceleration", acceleration)
    if not isinstance(vector, Vector):
        raise ParameterError(
            "an orbit follows from a solution with an acceleration, or from a Vector, not a "
            f"{type(acceleration).__name__}"
        )
    if vector.unit != "µas/yr":
        raise ParameterError(f"the acceleration must be in µas/yr, not in {vector.unit}")
    error = number("r0_error", r0_error)
    notes = tuple(map(str, getattr(acceleration, "notes", ())))
    return GalacticOrbit(vector.to_frame("galactic"), positive("r0", r0), abs(error), notes)
