from dataclasses import replace

import numpy as np
import pytest
from conftest import nonuniform

import fit
import sim
from fit.correlation import correlation_matrices, predict_covariance
from fit.secular_parallax import hubble_constant, observer_velocity
from fit.secular_parallax import predict_errors as predict_parallax
from vsh import Field


def test_prediction_is_the_covariance_of_the_fit_to_come():
    field = nonuniform()
    found, solution = predict_covariance(field, 3), fit.fit_field(field, 3)
    np.testing.assert_array_equal(found.covariance, solution.covariance)
    np.testing.assert_allclose(found.spin.sigma, solution.spin.sigma)
    assert np.isnan(found.coefficients.values).all()
    assert np.isnan(found.chi2)
    # By its definition: the sixth root of the ratio of determinants, against the same weight spread evenly.
    alone = fit.normal_equations(field, 1)
    even = np.diag(np.r_[1, 2, 2, 1, 2, 2] * field.information.sum() / (8 * np.pi))
    ratio = np.linalg.slogdet(alone.matrix)[1] - np.linalg.slogdet(even)[1]
    assert found.efficiency == pytest.approx(np.exp(ratio / 6), rel=1e-6)
    evenly = fit.correlation.predict_covariance(sim.Population(*sim.uniform_sky(50_000, 1), None), 1, sigma=1.0)
    assert evenly.efficiency == pytest.approx(1, abs=1e-3)
    assert "Prediction: degree 3" in repr(found)
    value, pair = predict_covariance(field, 1).largest
    assert value == pytest.approx(correlation_matrices(field).largest(0)[0])
    assert pair == correlation_matrices(field).largest(0)[1]


def test_predicted_velocity_and_hubble():
    galaxies = sim.galaxies(500, rng=1)
    velocity, hubble = predict_parallax(galaxies, 70.0, sigma=5.0, peculiar_dispersion=300.0)
    field = replace(Field.from_positions(galaxies, 5.0), redshift_frame="true")
    np.testing.assert_allclose(velocity.sigma, observer_velocity(field, 70.0, peculiar_dispersion=300.0).sigma)
    assert hubble.hubble_error == pytest.approx(
        hubble_constant(field, "planck", peculiar_dispersion=300.0, hubble=70.0).hubble_error, rel=1e-3
    )
    assert np.isnan(velocity.velocity.value).all()
