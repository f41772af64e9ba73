"""The equations of the secular parallax: what enters the variance of each."""

from dataclasses import replace

import numpy as np

import sim
from fit.distances import calibrate, inverse_distances
from fit.secular_parallax import observer_velocity
from fit.secular_parallax._equations import make_field_equations
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, FLAT_PLANCK13
from vsh.models.flows import LINEAR_PLANCK18


def test_unsure_distances_add_the_velocities_that_they_multiply():
    """s² (|v|²/3 + σ²) of a distance with variance s² and flows of dispersion σ, beside the error as quoted."""
    signal = sim.secular_parallax((300, 0, 0)) + sim.peculiar(300.0, 2)
    field = sim.observe(sim.galaxies(300, 1), signal, rng=1, sigma=5.0, redshifts="heliocentric")
    calibration = calibrate(field, dispersion=400.0)
    variance = inverse_distances(field, calibration).variance
    assert (variance > 0).all()
    ours = CMB_VELOCITY_PLANCK18.amplitude**2 / 3
    still, moving = (make_field_equations(field, calibration, theory=each) for each in (None, LINEAR_PLANCK18))
    n = len(field)
    np.testing.assert_allclose(still.variance[:n], 25.0 + variance * ours, rtol=1e-9)
    np.testing.assert_allclose(moving.variance[:n], 25.0 + variance * (ours + LINEAR_PLANCK18.sigma**2), rtol=1e-9)
    np.testing.assert_allclose(moving.left[:n], LINEAR_PLANCK18.sigma**2 * moving.rate[:n] ** 2, rtol=1e-9)
    assert (still.left == 0).all()


def test_distances_in_megaparsecs_need_no_hubble_constant():
    """Our velocity from them is the same for every H0, and its errors are."""
    galaxies = sim.galaxies(200, 1)
    field = sim.observe(galaxies, sim.secular_parallax((300, 0, 0)), rng=1, sigma=0.01, redshifts="heliocentric")
    distance = FLAT_PLANCK13.comoving_transverse_distance(galaxies.redshift).value
    field = replace(field, distance=distance, distance_error=1e-3 * distance)
    low, high = (observer_velocity(field, hubble).velocity for hubble in (60.0, 80.0))
    np.testing.assert_allclose(low.value, (300, 0, 0), atol=3)  # the errors are those of flows, which nothing has here
    np.testing.assert_allclose(high.value, low.value, atol=1)
    np.testing.assert_allclose(high.sigma, low.sigma, rtol=0.01)
