"""A circular orbit: acceleration, speed and radius, any one of them from two."""

import numpy as np

from vsh.tools.arguments import explained, not_negative, number, positive
from vsh.tools.units import AU_PER_YEAR, JULIAN_YEAR, KM_S_MYR

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
_PER_KPC = 1e6 * JULIAN_YEAR / 3.0856775814913673e16


def _square_over_radius(acceleration):
    """V²/R of an apparent acceleration. [(km/s)²/kpc]"""
    return acceleration / (KM_S_MYR * _PER_KPC)


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
    error = not_negative("acceleration_error", acceleration_error), not_negative("r0_error", r0_error)
    speed = np.sqrt(_square_over_radius(acceleration) * r0)
    return float(speed), float(speed / 2 * np.hypot(error[0] / acceleration, error[1] / r0))


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
    distance = _square_over_radius(acceleration) / speed**2
    return float(distance), float(distance * np.hypot(errors[0] / acceleration, 2 * errors[1] / speed))


@explained
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
    return float(speed**2 * positive("r0", r0) * KM_S_MYR * _PER_KPC)
