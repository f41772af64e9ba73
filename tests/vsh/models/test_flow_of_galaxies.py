"""The flow that the density of galaxies predicts."""

import numpy as np
import pytest

import sim
from vsh import ParameterError
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, flow_of_galaxies
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad

F, H = LINEAR_PLANCK18.growth_rate, hubble_value(FLAT_PLANCK13) / 100


@pytest.fixture(scope="module")
def clustered():
    population, grid = sim.clustered_galaxies(8000, 3, size=96)
    return population, grid, transverse_distance(population.redshift) * H


@pytest.fixture(scope="module")
def flow(clustered):
    population, _, distance = clustered
    return flow_of_galaxies(population.lon, population.lat, distance, size=64)


def across(population, velocity):
    p, q, _ = triad(population.lon, population.lat)
    return np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)])


def test_flow_of_a_plane_wave():
    """A density that goes as a sine along x, smoothed: velocities go as β H/k times a cosine, towards what is dense."""
    rng, half, k = np.random.default_rng(1), 100.0, 2 * np.pi / 80
    positions = rng.uniform(-half, half, (3, 400_000))
    keep = rng.uniform(0, 1.3, positions.shape[1]) < 1 + 0.3 * np.sin(k * positions[0])
    positions = positions[:, keep]
    radius = np.linalg.norm(positions, axis=0)
    positions, radius = positions[:, radius < half], radius[radius < half]
    lon, lat = np.arctan2(positions[1], positions[0]), np.arcsin(positions[2] / radius)
    flow = flow_of_galaxies(lon, lat, radius, beta=0.5, size=96, smoothing=6.0)
    x = np.linspace(-40, 40, 41)
    velocity, _ = flow.at(np.where(x < 0, np.pi, 0.0), np.zeros(41), np.abs(x), "icrs")
    expected = 0.5 * 100 * 0.3 / k * np.exp(-((k * 6) ** 2) / 2) * np.cos(k * x)
    slope, _ = np.polyfit(expected, velocity[0], 1)
    assert slope == pytest.approx(1.0, abs=0.1)
    assert np.corrcoef(velocity[0], expected)[0, 1] > 0.98


def test_flow_is_that_of_the_matter(clustered, flow):
    population, grid, distance = clustered
    pairs = [across(population, each.at(population.lon, population.lat, distance, "icrs")[0]) for each in (flow, grid)]
    less = [each / distance - np.mean(each / distance, 1, keepdims=True) for each in pairs]
    assert np.corrcoef(*(each.ravel() for each in less))[0, 1] > 0.6
    # Half of β makes half of the flow; a hidden plane changes it little.
    half = flow_of_galaxies(population.lon, population.lat, distance, beta=F / 2, size=64)
    np.testing.assert_allclose(half.velocity, flow.velocity / 2)
    keep = np.abs(population.lat) > np.radians(15)
    visible = np.abs(centres(16)[1]) > np.radians(15)
    where = population.lon[keep], population.lat[keep], distance[keep]
    seen, blind = (flow_of_galaxies(*where, size=64, visible=each) for each in (visible, None))
    error = [np.mean((each.velocity - flow.velocity) ** 2) for each in (seen, blind)]
    assert error[0] < 0.5 * error[1]


def test_messages(clustered):
    population, _, distance = clustered
    with pytest.raises(ParameterError, match="a hundred galaxies"):
        flow_of_galaxies(population.lon[:50], population.lat[:50], distance[:50])
    with pytest.raises(ParameterError, match="are wider than the smoothing: take a size of"):
        flow_of_galaxies(population.lon, population.lat, distance, size=16)
    with pytest.raises(ParameterError, match="HEALPix map"):
        flow_of_galaxies(population.lon, population.lat, distance, visible=np.ones(50, bool))
