"""The Sun, from which a scanning law keeps away."""

import numpy as np

from vsh.sky.sphere import sin_cos
from vsh.tools.types import FloatArray
from vsh.tools.units import DEGREE

YEAR = 365.25  # days
#: Rate of the Sun's mean longitude from the equinox of J2000 (that of date recedes by 50.29″ a year). [deg/day]
_MEAN_RATE = 0.9856474 - 50.29 / 3600 / YEAR


def _anomaly(start, time):
    days = (start - 2000.0 + time) * YEAR
    return (357.528 + 0.9856003 * days) * DEGREE, (280.460 + _MEAN_RATE * days) * DEGREE


def sun_position(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ecliptic longitude [rad] and distance [AU] of the Sun, equinox J2000, to 0.01° (Astronomical Almanac, C5)."""
    g, mean = _anomaly(start, time)
    sin, cos = sin_cos(g)
    # sin 2g = 2 sin g cos g, cos 2g = 2 cos² g − 1
    longitude = mean + (1.915 + 0.040 * cos) * sin * DEGREE
    return longitude, 1.00028 - (0.01671 + 0.00028 * cos) * cos


def sun_rate(start: float, time: FloatArray) -> FloatArray:
    """dλ/dt [rad/yr]."""
    g, _ = _anomaly(start, time)
    turn = 0.9856003 * DEGREE * YEAR
    return _MEAN_RATE * DEGREE * YEAR + (1.915 * np.cos(g) + 0.040 * np.cos(2 * g)) * DEGREE * turn


def sun_direction(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], so many years after the start."""
    longitude, distance = sun_position(start, np.asarray(time, float))
    sin, cos = sin_cos(longitude)
    return np.stack([cos, sin, np.zeros_like(sin)]), distance
