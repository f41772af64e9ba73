"""Summaries, predictions, draws and the BIC of a solution."""

import numpy as np
import pytest
from conftest import random_field

import fit
import sim
from vsh.tools.errors import FrameError, ParameterError


@pytest.fixture(scope="module")
def field():
    return sim.observe(sim.quasars(800, 1), sim.spin((0, 40, 0)), rng=2, sigma=100.0)


def test_summary_has_the_errors_of_the_result(field):
    for result in (fit.fit_field(field), fit.recommended(field), fit.estimate(field, 2, "student")):
        table = result.summary()
        assert list(table["parameter"][:3]) == ["spin_x", "spin_y", "spin_z"]
        np.testing.assert_allclose(table["error"], [*result.spin.sigma, *result.acceleration.sigma])
        np.testing.assert_allclose(table["value"], [*result.spin.value, *result.acceleration.value])
        assert str(table["value"].unit) == "uas / yr"
        assert (table["formal_error"] <= 1.05 * table["error"]).all()


def test_predictions_are_what_residuals_leave(field):
    solution = fit.fit_field(field)
    left = solution.residuals(field).motion
    np.testing.assert_allclose(solution.predict(field), field.motion - left, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(solution.predict(field), solution.predict(field.lon, field.lat))
    np.testing.assert_array_equal(solution.coefficients(0.1, 0.2), solution.coefficients.at(0.1, 0.2))
    with pytest.raises(FrameError):
        solution.predict(field.to_frame("galactic"))
    with pytest.raises(ParameterError, match="lon and lat"):
        solution.predict(field.lon)


def test_draws_have_the_covariance(field):
    solution = fit.fit_field(field, 1)
    draws = solution.sample(20_000, rng=1)
    assert np.abs(draws.mean(0) - solution.values).max() < 0.03 * solution.sigma.max()
    np.testing.assert_allclose(np.cov(draws, rowvar=False), solution.covariance, atol=0.04 * solution.covariance.max())
    # Of few replicates tails are those of Student's t.
    few = fit.resample.bootstrap(field, 1, 12, progress=False).quoted
    far = np.abs(few.sample(20_000) - few.values) > 3 * np.sqrt(np.diag(few.covariance))
    assert 0.008 < far.mean() < 0.018


def test_bic_prefers_the_degree_that_is_there():
    """A spin alone: degree 1, by 2 L (L + 2) ln n."""
    field = random_field(3000, 1)
    bics = [fit.fit_field(field, lmax).bic for lmax in (1, 2, 3)]
    assert bics == sorted(bics)
    one = fit.fit_field(field, 1)
    assert one.bic == pytest.approx(one.chi2 + 6 * np.log(6000))


def test_power_of_all_degrees(field):
    solution = fit.fit_field(field, 3)
    np.testing.assert_array_equal(solution.power("T"), [solution.power("T", l) for l in (1, 2, 3)])
