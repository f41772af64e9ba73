from dataclasses import replace

import numpy as np
import pytest
from conftest import nonuniform

import fit
import sim
from fit.correlation import compare_cuts, correlation_matrices, downweight, predict_covariance
from fit.correlation._forecast import reweight_field
from fit.secular_parallax import hubble_constant, observer_velocity
from fit.secular_parallax import predict_errors as predict_parallax
from vsh import Field
from vsh.sky.pixels import pixels_of
from vsh.tools.errors import FieldError


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


def test_plans_side_by_side():
    field = nonuniform()
    north = field.lat > 0
    table = compare_cuts(field, {"all": None, "north": north, "half the weight": np.full(len(field), 0.5)})
    assert list(table["case"]) == ["all", "north", "half the weight"]
    assert table["sources"][1] == north.sum()
    assert table["sigma_spin"][2] == pytest.approx(np.sqrt(2) * table["sigma_spin"][0])
    assert table["efficiency"][1] < table["efficiency"][0]
    for bad, words in ((np.ones(3), "one value a source"), (np.full(len(field), -1.0), "finite and not negative")):
        with pytest.raises(FieldError, match=words):
            compare_cuts(field, {"bad": bad})


def test_predicted_velocity_and_hubble():
    galaxies = sim.galaxies(500, rng=1)
    velocity, hubble = predict_parallax(galaxies, 70.0, sigma=5.0, peculiar_dispersion=300.0)
    field = replace(Field.from_positions(galaxies, 5.0), redshift_frame="true")
    np.testing.assert_allclose(velocity.sigma, observer_velocity(field, 70.0, peculiar_dispersion=300.0).sigma)
    assert hubble.hubble_error == pytest.approx(
        hubble_constant(field, "planck", peculiar_dispersion=300.0, hubble=70.0).hubble_error, rel=1e-3
    )
    assert np.isnan(velocity.velocity.value).all()


@pytest.mark.slow
@pytest.mark.parametrize("bound", [0.3, pytest.param(0.1, marks=pytest.mark.slow)])
def test_thinning_reaches_its_bound_at_little_cost(bound):
    field = nonuniform(20_000, 1)
    found = downweight(field, bound)
    assert abs(found.before.largest[0]) > 0.35
    assert abs(found.after.largest[0]) <= bound + 1e-3
    assert np.nanmin(found.keep) >= 0
    assert np.nanmax(found.keep) <= 1
    # Against the plain way, all pixels cut down to one density: the same bound costs less.
    ratio = np.sqrt(np.mean(found.after.acceleration.sigma**2) / np.mean(found.before.acceleration.sigma**2))
    pixels = pixels_of(field.lon, field.lat, 4)
    weight = np.bincount(pixels, field.weights[:2].sum(0), 192)
    flat = np.minimum(1, np.quantile(weight[weight > 0], 0.5) / weight[pixels])
    plain = predict_covariance(reweight_field(field, flat), 1)
    assert ratio < 1.35
    if abs(plain.largest[0]) >= bound:
        assert ratio < np.sqrt(np.mean(plain.acceleration.sigma**2) / np.mean(found.before.acceleration.sigma**2)) * 1.2
    mask = found.mask(rng=1)
    assert mask.mean() == pytest.approx(found.factors.mean(), abs=0.02)
