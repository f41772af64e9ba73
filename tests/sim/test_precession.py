"""The precession of the spin axis, in closed form, against its differential equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim.scanning._precession import Precession
from vsh.tools.errors import ParameterError


@pytest.mark.parametrize(("precessions", "xi", "start"), [
    (5.8, 0.7854, 0.0), (5.8, 0.7854, np.pi), (2.0, 0.7854, 1.0), (30.0, 0.2, -2.0), (6.0, 1.4, 4.0),
])  # fmt: skip
def test_both_equations_hold(precessions, xi, start):
    """ν and Ω of Lindegren & Bastian's equations, integrated to twelve digits, over two turns of the Sun."""
    found = Precession(precessions, xi)
    turned = np.linspace(0, 4 * np.pi, 50)

    def slope(_, state):
        rate = found.rate(state[0])
        return [rate, -rate * np.cos(xi) - np.sin(xi) * np.sin(state[0])]

    true = solve_ivp(slope, (0, turned[-1]), [start, 0.0], "DOP853", turned, rtol=1e-13, atol=1e-13).y
    nu = found.phase(start, turned)
    np.testing.assert_allclose(nu, true[0], atol=2e-10)
    np.testing.assert_allclose(found.lag(start, nu), true[1], atol=2e-10)


@pytest.mark.parametrize(("precessions", "xi"), [(5.8, 0.7854), (1.7, 0.7854), (400.0, 0.5)])
def test_it_goes_round_so_often(precessions, xi):
    """In one turn of the Sun ν gains 2π for each precession, exactly."""
    found = Precession(precessions, xi)
    np.testing.assert_allclose(found.phase(0.3, 2 * np.pi * np.arange(4) / precessions), 0.3 + 2 * np.pi * np.arange(4))


def test_too_slow_an_axis_is_refused():
    with pytest.raises(ParameterError, match=r"precessions must be at least 1.61 in a year"):
        Precession(1.0, np.pi / 4)
