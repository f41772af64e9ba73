"""Bootstrap and jackknife."""

import numpy as np
import pytest
from conftest import few_or_many

import fit
import sim
from fit import resample
from vsh import Coefficients, Field, Modes
from vsh.sky.pixels import centres, mean_map, pixels_of
from vsh.tools.errors import DegeneracyError, FieldError

SKY = sim.Population(*sim.plane_avoiding_sky(2000, rng=1), None)
TRUTH = Coefficients.from_vectors(rotation=(1, 2, 3), glide=(0, 4, 0))


def observed(seed):
    """Errors that are understated by a factor of 1.5: only resampling knows."""
    field = sim.observe(SKY, TRUTH, seed, sigma=45.0, rho=0.4)
    return Field(field.lon, field.lat, field.motion, np.full((2, len(field)), 30.0), field.rho)


METHODS = {
    "bootstrap": lambda field, seed: fit.resample.bootstrap(field, Modes(1), 200, seed, progress=False),
    "block bootstrap": lambda field, seed: fit.resample.block_bootstrap(field, Modes(1), 2, 400, seed, progress=False),
    "jackknife": lambda field, seed: fit.resample.jackknife(field, Modes(1), 4, progress=False),
}


@pytest.mark.slow
@few_or_many(40, 300, "skies")
@pytest.mark.parametrize("method", METHODS)
def test_intervals_cover_the_truth(method, skies):
    """68 % intervals hold the truth in 68 %; 300 skies, of six values each, tell it to 5 %."""
    inside = []
    for seed in range(skies):
        low, high = METHODS[method](observed(seed), seed).interval(0.68)
        inside.append((low < TRUTH.values) & (TRUTH.values < high))
    assert abs(np.mean(inside) - 0.68) < 0.05 * np.sqrt(300 / skies)


@pytest.mark.parametrize("method", METHODS)
def test_errors_are_the_scatter(method):
    found = METHODS[method](observed(1), 1)
    expected = 1.5 * fit.fit_field(observed(1), 1).sigma
    # 192 blocks at most know a standard deviation to 1/√(2·192) = 5 %, and share the six parameters' luck.
    np.testing.assert_allclose(found.sigma, expected, rtol=0.3)
    assert found.resampled_solution.errors_from.startswith(f"the {found.method}, ")
    np.testing.assert_allclose(found.spin.value, fit.fit_field(observed(1), 1).spin.value, rtol=1e-9)
    np.testing.assert_allclose(found.acceleration.covariance, found.resampled_solution.acceleration.covariance)


def test_numbers_of_draws_are_poisson():
    """Their table has mean 1 and variance 0.99997 over all 2¹⁶ entries, and e⁻¹ of them are zero."""
    draws = resample._POISSON.astype(float) + 1
    assert draws.mean() == pytest.approx(1, abs=1e-4)
    assert draws.var() == pytest.approx(1, abs=1e-3)
    assert np.mean(draws == 0) == pytest.approx(np.exp(-1), abs=1e-4)


@pytest.mark.parametrize("method", ["bootstrap", "block bootstrap"])
def test_seed_is_all_there_is(method):
    one, two, other = (METHODS[method](observed(1), seed).samples for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)


def test_fits_that_cannot_be_resampled():
    field = observed(3)
    near = field[pixels_of(field.lon, field.lat, 1) == 0]
    with pytest.raises(DegeneracyError, match="all sources lie in one block of nside 1"):
        fit.resample.jackknife(near, Modes(1), 1)
    with pytest.raises(FieldError, match="power of two from 1 to .*, not 3"):
        fit.resample.jackknife(field, Modes(1), 3)
    with pytest.raises(ValueError, match="n_replicates must be a whole number of at least 2"):
        fit.resample.bootstrap(field, Modes(1), 1, rng=1)
    with pytest.raises(ValueError, match="between 0 and 1"):
        fit.resample.bootstrap(field, Modes(1), 10, 1).interval(68)


def test_blocks_that_do_not_fit_into_memory_are_refused(monkeypatch):
    monkeypatch.setattr(resample, "MEMORY", 1000)
    with pytest.raises(DegeneracyError, match="do not fit into memory: lower nside from 2 or lmax from 1"):
        fit.resample.block_bootstrap(observed(1), Modes(1), 2, 10, rng=1)


def test_maps():
    lon, lat = centres(4)
    np.testing.assert_array_equal(pixels_of(lon, lat, 4), np.arange(192))
    found = mean_map(lon[[5, 5, 9]], lat[[5, 5, 9]], np.array([[1.0, 3.0, 7.0]]), 4)
    assert (found[0, 5], found[0, 9]) == (2.0, 7.0)
    assert np.isnan(found).sum() == 190
    with pytest.raises(FieldError, match="beyond a pole"):
        pixels_of([0.0], [2.0], 4)


@pytest.mark.parametrize(("n", "lmax", "few"), [(4000, 3, 60), (600, 2, 30)])
def test_errors_hold_where_few_sources_have_all_the_weight(n, lmax, few):
    """Pulls of 1.35 where the way was chosen by the number of sources, and 0.81 by drawing them again."""
    pulls = []
    for seed in range(20):
        rng = np.random.default_rng([5, seed])
        lon, lat = sim.uniform_sky(n, rng)
        sigma = np.full((2, n), 3000.0)
        sigma[:, :few] = 30.0
        field = Field(lon, lat, rng.normal(size=(2, n)) * sigma, sigma)
        found = fit.resample.bootstrap(field, lmax, 200, seed, progress=False)
        pulls.append(found.solution.values / found.sigma)
    # Some 300 pulls a case, those of a sky not independent: known to 5 %.
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2


def test_advice_on_blocks_says_where_errors_still_grow():
    rows = [resample.BlockErrors(k, 58.6 / k, 12 * k**2, 1.0, 0.1, None) for k in (8, 4, 2)]
    for tried, best, grows in ((rows, rows[-1], True), (rows, rows[0], False), (rows[:1], rows[0], False)):
        assert ("errors still grow" in resample._format_block_advice(tried, best)) == grows


@few_or_many(40, 300, "skies")
@pytest.mark.parametrize("method", ["block bootstrap", "jackknife"])
def test_p_values_of_few_blocks(method, skies):
    """Twelve blocks: p < 0.0027 came out on 4 % of skies, and on 8 % where few blocks have most of the weight."""
    p_values = []
    for seed in range(skies):
        rng = np.random.default_rng(seed)
        lon, lat = sim.uniform_sky(300, rng)
        sigma = np.full((2, 300), 30.0) * (1 + 2 * (lat > 0.5))
        field = Field(lon, lat, sigma * rng.normal(size=(2, 300)), sigma)
        if method == "jackknife":
            found = resample.jackknife(field, 1, 1, progress=False)
        else:
            found = resample.block_bootstrap(field, 1, 1, 150, seed, progress=False)
        assert found.resampled_solution.covariance_dof < 11
        p_values += [found.spin.p_value, found.acceleration.p_value]
    assert np.mean(np.array(p_values) < 0.0027) < 0.02
    assert np.mean(np.array(p_values) < 0.05) < 0.05 + 3 * np.sqrt(0.05 / len(p_values))
