"""Velocities of galaxies: in motions and in redshifts, drawn exactly and by modes."""

import numpy as np
import pytest

import sim
from vsh.models.cosmology import BACHCHAN_2016, FLAT_PLANCK13, to_cmb, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, VelocityGrid
from vsh.sky.sphere import triad
from vsh.tools.errors import ParameterError
from vsh.tools.units import AU_PER_YEAR

OURS = BACHCHAN_2016.to_frame("icrs").value
C = 299792.458


def places(n=300, seed=1):
    population = sim.galaxies(n, seed)
    return population.lon, population.lat, population.redshift


def test_our_own_motion_lowers_redshifts_toward_the_apex():
    lon, lat, z = places()
    signal = sim.secular_parallax(OURS)
    seen = signal.observed_redshift(lon, lat, z, "heliocentric")
    np.testing.assert_allclose(1 + seen, (1 + z) / (1 + OURS @ triad(lon, lat)[2] / C))
    np.testing.assert_array_equal(signal.observed_redshift(lon, lat, z, "true"), z)
    np.testing.assert_allclose(signal.observed_redshift(lon, lat, z, "cmb"), z)
    # Planck's velocity is a km/s from the paper's: the correction takes it away but for that.
    np.testing.assert_allclose(to_cmb(seen, lon, lat, "icrs", "heliocentric"), z, atol=1.5 / C)


@pytest.mark.parametrize(
    "options", [{}, {"length": 20.0}, {"flow": "linear", "n_modes": 200}, {"flow": "linear", "exact": True}]
)
def test_one_velocity_moves_source_and_redshift(options):
    lon, lat, z = places(200)
    signal = sim.peculiar(100.0, 5, **options)
    distance = transverse_distance(z)
    parts = [part.velocity(lon, lat, distance) for part in signal.parts]
    tangential, radial = sum(each[0] for each in parts), sum(each[1] for each in parts)
    np.testing.assert_allclose(signal(lon, lat, z), tangential / (AU_PER_YEAR * distance))
    seen = signal.observed_redshift(lon, lat, z, "cmb")
    np.testing.assert_allclose((1 + seen) / (1 + z), 1 + radial / C)
    again = sim.peculiar(100.0, 5, **options)
    np.testing.assert_array_equal(again(lon, lat, z), signal(lon, lat, z))


def test_redshifts_may_err():
    population = sim.galaxies(4000, 1)
    signal = sim.spin((0, 0, 0))
    for name, size in (("spectroscopic", 1e-4), ("photometric", 0.015)):
        field = sim.observe(population, signal, 2, redshift_error=name)
        pulls = (field.redshift - population.redshift) / field.redshift_error
        assert pulls.std() == pytest.approx(1, abs=0.05)
        assert field.redshift_error.mean() == pytest.approx(size, rel=0.05)
    plain = sim.observe(population, signal, 2)
    assert plain.redshift_error is None
    assert plain.redshift_frame == "true"
    np.testing.assert_array_equal(plain.motion, field.motion)  # errors of redshifts are drawn last


@pytest.mark.parametrize("exact", [True, pytest.param(False, id="modes", marks=pytest.mark.slow)])
def test_linear_flows_have_the_correlations_of_the_theory(exact):
    """Pairs on a line, 5 to 80 Mpc/h apart, over many skies: Ψ∥, Ψ⊥ within 2 % of σ²."""
    h = FLAT_PLANCK13.H0.value / 100
    steps = np.array([0.0, 5.0, 10.0, 20.0, 40.0, 80.0])
    first = np.array([-40.0, 25.0, 8.0])
    xyz = first[:, None] + np.array([1.0, 0, 0])[:, None] * steps
    r = np.linalg.norm(xyz, axis=0)
    lon, lat = np.arctan2(xyz[1], xyz[0]), np.arcsin(xyz[2] / r)
    p, q, u = triad(lon, lat)
    found = []
    for seed in range(2000 if exact else 600):
        flow = sim.peculiar(0.0, seed, flow="linear", exact=exact, n_modes=1000).parts[0]
        (east, north), radial = flow.velocity(lon, lat, r / h)
        found.append(east * p + north * q + radial * u)
    found = np.array(found)  # (skies, 3, places)
    along = np.mean(found[:, 0, :1] * found[:, 0], 0)
    across = np.mean(found[:, 1, :1] * found[:, 1] + found[:, 2, :1] * found[:, 2], 0) / 2
    expected = LINEAR_PLANCK18.correlation(steps)
    bound = 0.02 if exact else 0.12
    scatter = LINEAR_PLANCK18.sigma**2 * np.sqrt(2 / len(found))
    for one, two in zip((along, across), expected, strict=True):
        assert np.abs(one - two).max() < max(bound * LINEAR_PLANCK18.sigma**2, 3.5 * scatter)


def test_flow_from_a_grid():
    uniform = VelocityGrid(
        np.broadcast_to(np.array([100.0, 0, 0])[:, None, None, None], (3, 4, 4, 4)).copy(), 200.0, "icrs"
    )
    lon, lat, z = places(100)
    signal = sim.peculiar(0.0, 1, flow=uniform)
    r = triad(lon, lat)[2]
    np.testing.assert_allclose(signal.parts[0].radial(lon, lat, z), 100 * r[0], atol=1e-9)
    # A flow that all share is our own motion with the other sign.
    np.testing.assert_allclose(signal(lon, lat, z), -sim.secular_parallax((100.0, 0, 0))(lon, lat, z), atol=1e-9)
    with pytest.raises(ParameterError, match="outside of the grid"):
        signal(lon, lat, np.full(100, 0.2))


def test_bad_arguments_are_refused():
    lon, lat, z = places(10)
    with pytest.raises(ParameterError, match='a flow is "linear"'):
        sim.peculiar(0.0, 1, flow="cubic")
    many = sim.galaxies(7000, 1)
    with pytest.raises(ParameterError, match="too many to be drawn exactly"):
        sim.peculiar(0.0, 1, flow="linear", exact=True)(many.lon, many.lat, many.redshift)
    with pytest.raises(ParameterError, match="heliocentric, cmb or true"):
        sim.spin((0, 0, 1)).observed_redshift(lon, lat, z, "galactic")
    with pytest.raises(ParameterError, match="no redshifts that could be observed"):
        sim.observe(sim.Population(lon, lat, np.full(10, 18.0)), sim.spin((0, 0, 1)), 1, redshifts="cmb")
    with pytest.raises(ParameterError, match="spectroscopic, photometric"):
        sim.observe(sim.galaxies(10, 1), sim.spin((0, 0, 1)), 1, redshift_error="good")
