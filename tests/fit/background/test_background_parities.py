"""The likelihood of two powers by an expansion is the likelihood."""

import numpy as np
import pytest

import fit
import sim
from fit.background import equations_of, floor
from fit.background._amplitude import posteriors
from fit.background._likelihood import Likelihood, Parities
from vsh import Coefficients, Field, Modes
from vsh.models.covariance import Spectrum
from vsh.tools.errors import ConvergenceError


def equations(lmax, odd, even, latitude=0.0, n=6000, south=-1.0):
    rng = np.random.default_rng(lmax)
    lon, lat = sim.plane_avoiding_sky(n, rng, latitude=latitude)
    lon, lat = lon[np.sin(lat) > south], lat[np.sin(lat) > south]
    modes, spectrum = Modes(lmax), odd * Spectrum.odd() + even * Spectrum.even()
    truth = Coefficients(modes, np.sqrt(spectrum.variances(modes)) * rng.normal(size=len(modes)))
    motion = truth.at(lon, lat) + 100 * rng.normal(size=(2, lon.size))
    return equations_of(fit.normal_equations(Field(lon, lat, motion, np.full(motion.shape, 100.0)), lmax))


@pytest.mark.parametrize(("odd", "even"), [(0.0, 0.0), (40.0, 8.0), (0.0, 300.0)])
def test_expansion_is_the_likelihood(odd, even):
    """Maxima, their ln L, and quantiles of both powers to a thousandth; a tenth of the sky is empty."""
    normal, degrees = equations(13, odd, even, latitude=6.0), range(2, 14)
    expanded = Parities(normal, degrees, (1,))
    plain = Likelihood(normal, [Spectrum.odd(), Spectrum.even()], degrees, (1,))
    for ratios in plain.unit * np.array([[0, 0], [1, 0], [0.1, 3], [100, 1]]):
        np.testing.assert_allclose(expanded.exact(ratios), plain.parts(ratios), rtol=1e-9, atol=1e-9)
    one, two = expanded.maximum(), plain.maximum()
    np.testing.assert_allclose(one.amplitudes, two.amplitudes, rtol=2e-3, atol=1e-3 * plain.unit.max())
    assert one.log_likelihood == pytest.approx(two.log_likelihood, abs=0.01)
    for a, b in zip(posteriors(expanded, one)[0], posteriors(plain, two)[0], strict=True):
        for probability in (0.16, 0.5, 0.84, 0.975):
            assert a.quantile(probability, "root") == pytest.approx(b.quantile(probability, "root"), rel=2e-3)
    flat = Likelihood(normal, [Spectrum.flat()], degrees, (1,)).maximum()
    assert expanded.together() == pytest.approx(flat.log_likelihood, abs=0.01)


def test_slopes_are_those_of_the_parts():
    normal = equations(13, 20.0, 10.0, latitude=6.0)
    expanded = Parities(normal, range(2, 14), (1,))
    ratios = np.array([18.0, 12.0])
    logdet, gain, by_logdet, by_gain = expanded.slopes(ratios)
    np.testing.assert_allclose((logdet, gain), expanded.parts(ratios))
    for i, axis in enumerate(np.eye(2)):
        change = np.subtract(expanded.parts(ratios + 1e-3 * axis), expanded.parts(ratios - 1e-3 * axis)) / 2e-3
        np.testing.assert_allclose((by_logdet[i], by_gain[i]), change, rtol=1e-3)


@pytest.mark.parametrize(("lmax", "south", "power"), [(13, 0.0, 2000.0), (13, 0.0, 1e5), (16, -0.5, 2000.0)])
def test_strong_field_on_a_part_of_the_sky_has_its_floor(lmax, south, power):
    """Where I − S Sᵀ is singular to rounding the expansion gives way to the plain likelihood."""
    normal = equations(lmax, power, power, south=south)
    with pytest.raises(ConvergenceError, match="mixes the parities"):
        Parities(normal, range(2, lmax + 1), (1,))
    whole = floor(normal, shapes="flat")
    assert 0.7 * power < whole.odd < 1.4 * power
    assert 0.7 * power < whole.even < 1.4 * power


@pytest.mark.slow
def test_sky_that_mixes_the_parities_is_taken_as_it_is(monkeypatch):
    """Three tenths of the sky: the expansion says so, and the floor is that of the plain likelihood."""
    normal = equations(13, 1000.0, 1.0, south=0.4)
    with pytest.raises(ConvergenceError, match="mixes the parities"):
        Parities(normal, range(2, 14), (1,))
    found = floor(normal, shapes=("flat",))
    monkeypatch.setattr("fit.background._floor._AS_IT_IS", 20)
    plain = floor(normal, shapes=("flat",))
    assert (found.odd, found.even, found.parity_p_value) == (plain.odd, plain.even, plain.parity_p_value)
