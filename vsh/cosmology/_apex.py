"""Our own motion through the Universe: as the dipole of the microwave background tells it, and as users give it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vsh.checks.arguments import number
from vsh.errors import ParameterError
from vsh.sky.frames import check_frame
from vsh.vector import Vector

#: Planck Collaboration (2020, A&A 641, A1), table 3: toward the apex. [km/s]
PLANCK_2018 = Vector.from_spherical(369.82, 264.021, 48.253, (0.11, 0.011, 0.005), "galactic", "km/s")
#: What Bachchan, Hobbs & Lindegren (2016, A&A 589, A71) put into their simulations. [km/s]
BACHCHAN_2016 = Vector.from_spherical(369.0, 263.99, 48.26, frame="galactic", unit="km/s")
#: Velocities that have names, in every command and study.
VELOCITIES = {"planck": PLANCK_2018, "paper": BACHCHAN_2016}


def velocity_along(value: Any, frame: str) -> Vector:
    """A velocity along the axes of `frame`."""
    check_frame(frame)
    if isinstance(value, str):
        if value not in VELOCITIES:
            raise ParameterError(
                f"no velocity is called {value!r}; there are {', '.join(VELOCITIES)}, or give three numbers in km/s"
            )
        value = VELOCITIES[value]
    if not isinstance(value, Vector):
        try:
            three = np.asarray(value, float)
        except (TypeError, ValueError):
            three = np.empty(0)
        if three.shape != (3,):
            raise ParameterError(f"a velocity has three components, not {value!r}")
        if not (np.isfinite(three).all() and three.any()):
            raise ParameterError(
                f"a velocity of {three} km/s has no direction: a secular parallax cannot be scaled by it"
            )
        value = Vector(three, np.zeros((3, 3)), frame, "km/s")
    if not value.amplitude > 0:
        raise ParameterError(
            f"a velocity of {value.amplitude} km/s has no direction: a secular parallax cannot be scaled by it"
        )
    return replace(value.to_frame(frame), unit="km/s")


def velocity_from_apex(speed: float, l: float, b: float) -> Vector:
    """A velocity of so many km/s toward Galactic longitude and latitude [deg], without error.

    Parameters
    ----------
    speed : float
        [km/s]
    l : float
        Galactic longitude. [deg]
    b : float
        Galactic latitude. [deg]

    Raises
    ------
    ParameterError
        If the speed is not above zero, or the direction is none.
    """
    speed, l, b = (number(name, x) for name, x in (("speed", speed), ("l", l), ("b", b)))
    if not (0 < speed < 3e5 and abs(l) <= 360 and abs(b) <= 90):
        raise ParameterError(
            f"a velocity is SPEED,L,B: km/s above zero, Galactic longitude and latitude of the apex in degrees; not "
            f"{speed:g},{l:g},{b:g}"
        )
    return Vector.from_spherical(speed, l, b, frame="galactic", unit="km/s")
