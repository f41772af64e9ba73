"""Redshifts in a frame that somebody told, or nobody."""

import numpy as np
import pytest

import sim
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh import Field
from vsh.models.cosmology import BACHCHAN_2016, CMB_VELOCITY_PLANCK18, to_cmb
from vsh.sky.sphere import triad
from vsh.tools.errors import VshWarning

OURS = BACHCHAN_2016.to_frame("icrs").value
ACCELERATION = np.array([-0.236, -3.756, -2.080])


def galaxies(n, seed=1):
    truth = sim.secular_parallax(OURS) + sim.acceleration(ACCELERATION)
    return sim.observe(sim.galaxies(n, seed), truth, [seed, 2], sigma=2.0, rho=0.3)


def test_frame_that_nobody_told_is_asked_for_once():
    field = galaxies(200)
    bare = Field(
        field.lon, field.lat, field.motion, field.sigma, field.rho, redshift=field.redshift, magnitude=field.magnitude
    )
    with pytest.warns(VshWarning, match="the frame of the redshifts is not given.*redshift_frame=") as seen:
        found = observer_velocity(bare, 67.3)
    assert len(seen) == 1
    np.testing.assert_array_equal(found.values, observer_velocity(field, 67.3).values)  # taken as true ones
    assert "warning: the frame" in found.report()
    declared = observer_velocity(bare, 67.3, redshift_frame="cmb")
    assert not any("nobody says" in str(note) for note in declared.notes)
    with pytest.warns(VshWarning, match="the frame of the redshifts is not given"):
        hubble_constant(bare, CMB_VELOCITY_PLANCK18)


def test_heliocentric_redshifts_on_half_a_sky():
    """The half toward the apex: redshifts that are not corrected bias the velocity; with the frame they do not."""
    rng = np.random.default_rng(2)
    population = sim.galaxies(60_000, rng, min_redshift=2e-4, max_redshift=0.04)
    population = population[OURS @ triad(population.lon, population.lat)[2] > 0]
    truth = sim.secular_parallax(OURS) + sim.acceleration(ACCELERATION)
    field = sim.observe(population, truth, rng, sigma=0.01, redshifts="heliocentric")
    z = to_cmb(field.redshift, field.lon, field.lat, "icrs", "heliocentric")
    field = field[(z > 0.002) & (z < 0.03)]
    options = {"peculiar_dispersion": 1e-3, "flows": None}
    right = observer_velocity(field, 67.3, **options)
    wrong = observer_velocity(field, 67.3, redshift_frame="cmb", **options)
    assert right.velocity.value @ OURS / 369 == pytest.approx(369, abs=3)
    assert abs(wrong.velocity.value @ OURS / 369 - 369) > 20
