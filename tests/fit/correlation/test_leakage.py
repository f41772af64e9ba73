import numpy as np
import pytest
from conftest import nonuniform

import fit
import sim
from fit.background import SHAPES, floor
from fit.correlation import leakage, lmax_table, predict_covariance
from vsh import Coefficients, Field, Modes
from vsh.sky.pixels import centres


def test_leakage_is_the_bias_of_a_noiseless_fit():
    field = nonuniform(1000, 5)
    rng = np.random.default_rng(1)
    modes = Modes(5)
    c = rng.normal(size=len(modes))
    c[[mode.l <= 2 for mode in modes]] = 0
    truth = Coefficients(modes, c)
    found = leakage(field, 2, 5)
    biased = fit.fit_field(field._derive(motion=truth.at(field.lon, field.lat)), 2)
    np.testing.assert_allclose(found.of(truth).values, biased.coefficients.values, atol=1e-9)
    assert found.matrix.shape == (16, 54)
    assert found.names[0] == "t(1,0)"
    assert found.unmodelled_names[0] == "t(3,0)"
    assert len(found.to_table()) == 16


@pytest.mark.slow
def test_mean_squared_bias_of_2000_skies():
    """200 would tell the mean square of six components to 4 % only."""
    field = nonuniform(500, 6)
    power = np.array([3.0, 2.0, 1.0, 0.5, 0.25])
    found = leakage(field, 1, 6)
    expected = found.bias(power)
    squares = np.zeros(6)
    for seed in range(2000):
        truth = sim.random_field(np.r_[0.0, power], rng=seed)
        solution = fit.fit_field(field._derive(motion=truth(field.lon, field.lat)), 1)
        squares += solution.coefficients.values**2 / 2000
    assert np.mean(squares / expected**2) == pytest.approx(1, abs=0.05)
    np.testing.assert_allclose(found.bias({2: 3.0, 3: 2.0, 4: 1.0, 5: 0.5, 6: 0.25}), expected)
    np.testing.assert_allclose(found.bias(np.stack([power, power])), expected)
    np.testing.assert_allclose(found.bias(4 * power), 2 * expected)
    vector = found.bias_of(("a_x", "a_y", "a_z"), power)
    assert set(vector) == {"a_x", "a_y", "a_z"}


def test_even_sky_leaks_nothing():
    lon, lat = centres(16)
    field = Field(lon, lat, np.zeros((2, lon.size)), np.ones((2, lon.size)))
    assert np.abs(leakage(field, 2, 4).matrix).max() < 2e-3
    assert predict_covariance(field, 1).efficiency == pytest.approx(1, abs=1e-3)
    assert max(row[2] for row in lmax_table(field, 4)) < 5e-3


def test_forecasts_with_what_sources_share():
    """Of a spectrum, as a dense sum says; of a floor with two shapes, as the fit of a sky of these errors has them."""
    field = nonuniform(400, 3)
    modes, spectrum = Modes(4), 1e4 * SHAPES["flat"]
    normal = fit.normal_equations(field, modes)
    first = modes.degrees == 1
    prior = np.diag(np.where(first, 0.0, 1 / spectrum.variances(modes)))
    expected = np.linalg.inv(normal.matrix + prior) + np.diag(np.where(first, spectrum.variances(modes), 0.0))
    np.testing.assert_allclose(predict_covariance(field, 4, floor=spectrum).covariance, expected, rtol=1e-8)
    seen = sim.systematics(spectrum, rng=1)
    seen = field._derive(
        motion=seen(field.lon, field.lat) + field.sigma * np.random.default_rng(2).normal(size=(2, 400))
    )
    normal = fit.normal_equations(seen, modes)
    found = floor(normal, noise_scale=False)
    wanted, told = fit.solve(normal, floor=found), predict_covariance(seen, 4, floor=found)
    # Those of the fit hold the scatter of what the two shapes make of the sky as well.
    ratio = np.sqrt(np.diag(told.covariance) / np.diag(wanted.covariance))
    assert 0.9 < ratio.min() <= ratio.max() < 1 + 1e-9
    assert told.acceleration.sigma.mean() > 1.1 * predict_covariance(seen, 4).acceleration.sigma.mean()
    assert "systematic errors" in told.errors_from


def test_condition_and_correlation_by_degree():
    field = nonuniform(20_000, 1, uniform_errors=True)
    rows = lmax_table(field, 4)
    for lmax, condition, correlation in rows:
        solution = fit.solve(fit.normal_equations(field, Modes(lmax)))
        assert correlation == pytest.approx(np.abs(solution.correlation - np.eye(len(solution.modes))).max(), rel=1e-8)
        diagonal = 1 / np.sqrt(np.diag(fit.normal_equations(field, Modes(lmax)).matrix))
        scaled = fit.normal_equations(field, Modes(lmax)).matrix * np.outer(diagonal, diagonal)
        assert condition == pytest.approx(np.linalg.cond(scaled), rel=1e-6)
    assert lmax_table(field[:10], 4)[-1] == (4, np.inf, 1.0)
