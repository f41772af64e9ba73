"""The precession of the spin axis, in closed form, against its differential equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim.scanning import NominalScanningLaw, sun_position
from sim.scanning._crossings import Cubics
from sim.scanning._nominal import Precession
from vsh.sky.frames import rotation_matrix
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
def test_precession_has_its_period(precessions, xi):
    """In one turn of the Sun ν gains 2π for each precession, exactly."""
    found = Precession(precessions, xi)
    np.testing.assert_allclose(found.phase(0.3, 2 * np.pi * np.arange(4) / precessions), 0.3 + 2 * np.pi * np.arange(4))


def test_too_slow_an_axis_is_refused():
    with pytest.raises(ParameterError, match=r"precessions must be at least 1.61 in a year"):
        Precession(1.0, np.pi / 4)


@pytest.mark.parametrize("quiet", [0.0, 28.0])
def test_law_follows_its_equations_between_steps(quiet):
    """The spin axis at any time stands where the closed form has it, to two milliarcseconds: steps are half a day."""
    law = NominalScanningLaw(years=2.0, pole_days=quiet)
    time = np.random.default_rng(1).uniform((quiet + 1) / 365.25, 2, 3000)
    sun = sun_position(law.start, np.append(quiet / 365.25, time))[0]
    start = np.pi * round(law.precession_phase / np.pi) if quiet else law.precession_phase
    found = Precession(law.precessions, law.solar_aspect)
    nu = found.phase(start, sun[1:] - sun[0])
    xi = law.solar_aspect
    axis = np.stack([
        np.cos(xi) * np.cos(sun[1:]) - np.sin(xi) * np.cos(nu) * np.sin(sun[1:]),
        np.cos(xi) * np.sin(sun[1:]) + np.sin(xi) * np.cos(nu) * np.cos(sun[1:]),
        np.sin(xi) * np.sin(nu),
    ])  # fmt: skip
    z, preceding, following = law.attitude(time)
    np.testing.assert_allclose(rotation_matrix("icrs", "ecliptic") @ z, axis, atol=1e-8)
    turns = np.cross(following, preceding, axis=0) / np.sin(law.basic_angle)  # both fields go round the axis
    np.testing.assert_allclose(turns, z, atol=1e-13)


def test_cubics_have_values_and_slopes():
    """A cubic is itself, between steps and beyond them."""
    at, power = np.linspace(0, 4, 9), np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    found, x = Cubics(0.5, power(at), power.deriv()(at)), np.linspace(-1, 5, 50)
    np.testing.assert_allclose(found(x), power(x), atol=1e-12)
    np.testing.assert_allclose(found.slope(x), power.deriv()(x), atol=1e-12)
