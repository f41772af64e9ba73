"""Spectra of fields: powers, variances, covariance functions there and back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import eval_jacobi, eval_legendre

import sim
from vsh import Modes, ScalarModes
from vsh.basis import harmonics
from vsh.models.covariance import (
    LINDEGREN_2021,
    LINDEGREN_2021_PARALLAX,
    VASILIEV_BAUMGARDT_2021,
    ScalarSpectrum,
    Spectrum,
    d_minus,
    d_plus,
    wave_fractions,
)
from vsh.sky.sphere import triad
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.units import hubble_rate

# The published functions, their power in degrees 1 … 5 of one kind, and the glide they imply in each component.
PUBLISHED = [
    (VASILIEV_BAUMGARDT_2021, [273.8, 318.0, 346.3, 317.1, 291.3], 3.30),
    (LINDEGREN_2021, [218.3, 291.2, 306.9, 288.8, 257.0], 2.95),
]


@pytest.mark.parametrize(("function", "powers", "error"), PUBLISHED)
def test_published_functions(function, powers, error):
    spectrum = Spectrum.from_covariance(function)
    np.testing.assert_allclose(spectrum.power(5), [powers, powers], atol=0.05)
    assert spectrum.acceleration_error == pytest.approx(error, abs=0.005)
    assert spectrum.spin_error == spectrum.acceleration_error
    theta = np.linspace(0.1, 1.5, 8)
    np.testing.assert_allclose(spectrum.covariance(theta, 400), function(theta), atol=1e-2 * function(0.1))


def test_power_there_and_back():
    """A function made of a few degrees has their power and no other."""
    rng = np.random.default_rng(1)
    power = rng.uniform(0, 5, 12)
    spectrum = Spectrum.given(power)
    again = Spectrum.from_covariance(lambda theta: spectrum.covariance(theta, 12))
    np.testing.assert_allclose(again.power(20)[0], np.r_[power, np.zeros(8)], atol=1e-9)


def test_wigner_functions_are_jacobi_polynomials():
    theta = np.linspace(0, np.pi, 31)
    x, l = np.cos(theta), np.arange(1, 61)[:, None]
    np.testing.assert_allclose(d_plus(60, theta), (1 + x) / 2 * eval_jacobi(l - 1, 0, 2, x), atol=1e-12)
    np.testing.assert_allclose(d_minus(60, theta), (1 - x) / 2 * eval_jacobi(l - 1, 2, 0, x), atol=1e-12)


def test_spectra_by_name():
    l = np.arange(1, 7)
    odd, even = Spectrum.odd().power(6), Spectrum.even().power(6)
    np.testing.assert_array_equal(odd + even, Spectrum.flat().power(6))
    np.testing.assert_array_equal(odd[0] > 0, l % 2 == 1)  # the toroidal ones of odd degree, a spin among them
    np.testing.assert_array_equal(even[1] > 0, l % 2 == 1)
    np.testing.assert_allclose(Spectrum.power_law(-2).power(6), np.stack([l**-2.0] * 2))
    waves = 4 * np.pi * hubble_rate(70) ** 2 * wave_fractions(6) / 2
    np.testing.assert_allclose(Spectrum.waves(hubble=70).power(6), np.stack([waves] * 2))
    both = 2 * Spectrum.odd() + Spectrum.even() * 3
    np.testing.assert_array_equal(both.power(6), 2 * odd + 3 * even)
    assert (repr(both), both.name) == (
        "<Spectrum: 2 × odd parity + 3 × even parity>",
        "2 × odd parity + 3 × even parity",
    )


def test_variances_have_the_power():
    """Every coefficient drawn with its variance: on average the power of each kind and degree."""
    modes, spectrum = Modes(5), Spectrum.given([1.0, 2, 3, 4, 5], [5.0, 4, 3, 2, 1])
    variances = spectrum.variances(modes)
    for row, kind in enumerate("TS"):
        for l in range(1, 6):
            part = modes.slice_of(kind, l)
            assert np.sum(modes.norm2[part] * variances[part]) == pytest.approx(spectrum.power(5)[row, l - 1])


@pytest.mark.parametrize(("parity", "rising"), [("odd", -1), ("even", 1)])
def test_systematics_of_one_parity(parity, rising):
    """An odd field turns like a spin: at the antipode its vectors, seen in space, point the other way."""
    signal = sim.systematics(LINDEGREN_2021, 3, parity=parity)
    lon, lat = sim.uniform_sky(50, 1)
    p, q, _ = triad(lon, lat)
    there = signal(lon, lat)
    back = signal(lon + np.pi, -lat)
    p2, q2, _ = triad(lon + np.pi, -lat)
    np.testing.assert_allclose(back[0] * p2 + back[1] * q2, rising * (there[0] * p + there[1] * q), atol=1e-8)


def test_systematics_have_their_spectrum():
    spectrum = 3 * Spectrum.odd() + Spectrum.even()
    powers = np.zeros((2, 6))
    for seed in range(400):
        field = sim.systematics(spectrum, seed, lmax=6).parts[0].coefficients
        powers += [[field.power(kind, l) for l in range(1, 7)] for kind in "TS"]
    expected = spectrum.power(6)
    scatter = expected * np.sqrt(2 / (400 * (2 * np.arange(1, 7) + 1)))
    assert (np.abs(powers / 400 - expected) < 4 * scatter).all()


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Spectrum.given([1.0, -2.0]), "one power of at least zero for each degree"),
    (lambda: Spectrum.given([1.0, 2.0]).power(3), "is given to degree 2, and degree 3 is expected"),
    (lambda: Spectrum.from_covariance(lambda theta: -np.exp(-theta)).power(4), r"power of T\d is -.* no field has a negative"),
    (lambda: Spectrum.from_covariance(7), "takes angles in rad, not int"),
    (lambda: -1 * Spectrum.flat(), "must be zero or more"),
    (lambda: sim.systematics(Spectrum.flat(), 1, parity="left"), "parity must be one of"),
    (lambda: Spectrum("power 7", lambda lmax: np.full((2, lmax), np.nan)).power(2), "power 7"),
    *((lambda bad=bad: Spectrum.flat().power(bad), "at least 1") for bad in (0, -1, "x")),
])  # fmt: skip
def test_values_that_are_no_spectrum_are_refused(make, words):
    with pytest.raises((ParameterError, ModesError), match=words):
        make()


def test_scalar_spectrum_is_that_of_its_covariance():
    spectrum, theta = ScalarSpectrum.from_covariance(LINDEGREN_2021_PARALLAX), np.radians([3.0, 30.0, 120.0])
    degrees = np.arange(401)
    legendre = eval_legendre(degrees[:, None], np.cos(theta))
    assert_allclose(spectrum.power(400)[0] @ legendre / (4 * np.pi), LINDEGREN_2021_PARALLAX(theta), atol=0.2)
    modes = ScalarModes(3)
    rows, at = harmonics([0.3, 1.0], [0.1, -0.4], modes)[:, 0], spectrum.variances(modes)
    between = np.cos(np.arccos(np.sin(0.1) * np.sin(-0.4) + np.cos(0.1) * np.cos(-0.4) * np.cos(0.7)))
    expected = spectrum.power(3)[0] @ eval_legendre(np.arange(4), between) / (4 * np.pi)
    assert (rows[:, 0] * at) @ rows[:, 1] == pytest.approx(expected)  # the addition theorem
    assert (spectrum.mean_error, spectrum.dipole_error) == pytest.approx(
        np.sqrt(spectrum.power(1)[0] / (4 * np.pi)).tolist()
    )
    with pytest.raises(ModesError, match="ScalarModes"):
        spectrum.variances(Modes(2))
