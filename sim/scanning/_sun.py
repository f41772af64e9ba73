"""Where the Sun is, well enough to point a telescope away from it."""

from __future__ import annotations

import numpy as np

from vsh.checks.types import FloatArray
from vsh.units import DEGREE

YEAR = 365.25  # days
#: Of the Sun's mean longitude from the equinox of J2000 (that of date recedes by 50.29″ a year). [deg/day]
_MEAN_RATE = 0.9856474 - 50.29 / 3600 / YEAR


def _anomaly(start, time):
    days = (start - 2000.0 + time) * YEAR
    return (357.528 + 0.9856003 * days) * DEGREE, (280.460 + _MEAN_RATE * days) * DEGREE


def sun_position(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ecliptic longitude [rad] and distance [AU] of the Sun, equinox J2000, to 0.01° (Astronomical Almanac, C5).

    Parameters
    ----------
    start : float
        Of the mission. [Julian year]
    time : (k,) array
        Since the start of the mission. [yr]

    Returns
    -------
    tuple[array, array]
    """
    g, mean = _anomaly(start, time)
    longitude = mean + (1.915 * np.sin(g) + 0.020 * np.sin(2 * g)) * DEGREE
    return longitude, 1.00014 - 0.01671 * np.cos(g) - 0.00014 * np.cos(2 * g)


def sun_rate(start: float, time: FloatArray) -> FloatArray:
    """dλ/dt [rad/yr].

    Parameters
    ----------
    start : float
        Of the mission. [Julian year]
    time : (k,) array
        Since the start of the mission. [yr]
    """
    g, _ = _anomaly(start, time)
    turn = 0.9856003 * DEGREE * YEAR
    return _MEAN_RATE * DEGREE * YEAR + (1.915 * np.cos(g) + 0.040 * np.cos(2 * g)) * DEGREE * turn
