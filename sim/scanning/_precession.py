"""How fast the spin axis goes round the Sun."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq


def precession_speed(precessions: float, xi: float) -> float:
    """S for a number of precessions a year: one turn of ν takes 1/K of a turn of λ."""

    def turn(speed):
        return quad(
            lambda nu: np.sin(xi) / (np.sqrt(speed**2 - np.cos(nu) ** 2) + np.cos(xi) * np.sin(nu)), 0, 2 * np.pi
        )[0]

    return brentq(lambda speed: turn(speed) * precessions - 2 * np.pi, 1.5, 50.0, xtol=1e-12)
