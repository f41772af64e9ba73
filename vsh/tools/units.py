"""The few constants between the outside and (rad, µas/yr).

Each is the product of defining constants: the astronomical unit (IAU 2012 B2), the Julian year and the speed of light.
"""

import math

DEGREE = math.pi / 180  # rad
UAS = DEGREE / 3.6e9  # rad
MAS = 1000.0  # µas

JULIAN_YEAR = 365.25 * 86400.0  # s
AU = 149_597_870.7  # km
SPEED_OF_LIGHT = 299_792.458  # km/s

#: Speed of one astronomical unit a Julian year: µ [µas/yr] = v [km/s] / (4.740470 d [Mpc]).
AU_PER_YEAR = AU / JULIAN_YEAR  # km/s

#: Apparent motion ã = a/c of an acceleration of 1 km/s per million years. [µas/yr]
KM_S_MYR = 1 / (SPEED_OF_LIGHT * 1e6 * UAS)


def hubble_rate(hubble: float) -> float:
    """H0 as an angular rate, as angles would change in an expansion on one axis only. [µas/yr]"""
    # d = 1 Mpc recedes at `hubble` km/s: the angle v / d.
    return hubble / AU_PER_YEAR
