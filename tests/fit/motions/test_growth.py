"""The growth rate from motions and the density of galaxies: the flow, the fit against dense matrices, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import sim
from fit.motions.growth import growth
from vsh import DegeneracyError, FieldError, ParameterError
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, flow_of_galaxies
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools.units import AU_PER_YEAR

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


def test_fit_is_that_of_dense_matrices(clustered, flow):
    population, grid, _ = clustered
    field = sim.observe(population, sim.peculiar(200.0, 4, flow=grid) + sim.spin((3.0, -2.0, 1.0)), 5, sigma=25.0)
    field = replace(field, rho=np.full(len(field), 0.4))
    result = growth(field, flow, dispersion=250.0, reconstruction_error=0.0)
    used = field[field.redshift > 0.005]
    distance = transverse_distance(used.redshift)
    velocity, _ = flow.at(used.lon, used.lat, distance * H, "icrs")
    p, q, _ = triad(used.lon, used.lat)
    rate = 1 / (AU_PER_YEAR * distance)

    def motions(vectors):
        return np.stack([np.sum(vectors * p, 0), np.sum(vectors * q, 0)])

    r = triad(used.lon, used.lat)[2]
    columns = [rate * motions(velocity) / F]
    columns += [-rate * motions(np.outer(axis, np.ones(len(used)))) for axis in np.eye(3)]
    columns += [motions(np.cross(axis, r.T).T) for axis in np.eye(3)]
    columns += [motions(np.outer(axis, np.ones(len(used)))) for axis in np.eye(3)]
    covariance = np.zeros((len(used), 2, 2))
    covariance[:, 0, 0] = covariance[:, 1, 1] = 25.0**2 + (250 * rate) ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.4 * 25.0**2
    inverse = np.linalg.inv(covariance)
    design = np.array(columns)
    normal = np.einsum("pin,nij,qjn->pq", design, inverse, design)
    rhs = np.einsum("pin,nij,jn->p", design, inverse, used.motion)
    np.testing.assert_allclose(result.values, np.linalg.solve(normal, rhs), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(result.covariance, np.linalg.inv(normal), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(result.spin.value, [3, -2, 1], atol=4 * result.spin.sigma.max())
    assert np.all(np.abs(result.beta[0] - F) < 4 * result.beta[1])
    np.testing.assert_allclose(
        result.model(used), np.tensordot(result.values[1:], design[1:], 1), atol=1e-10 * np.abs(used.motion).max()
    )
    wider = growth(field, flow, dispersion=250.0)
    assert wider.beta[1] == pytest.approx(np.hypot(result.beta[1], 0.2 * result.beta[0]))


def test_report_and_limit(clustered, flow):
    population, *_ = clustered
    field = sim.observe(population, sim.spin((0.0, 0.0, 0.0)), 6, sigma=60.0)
    result = growth(field, flow)
    value, error = result.beta
    # By drawing the truth, flat, and what is seen of it: noise, and what the flow misses.
    rng, noise = np.random.default_rng(1), np.sqrt(error**2 - (0.2 * value) ** 2)
    true = rng.uniform(0, 12 * error, 4_000_000)
    seen = true + np.hypot(noise, 0.2 * true) * rng.standard_normal(len(true))
    near = np.abs(seen - value) < 0.02 * error
    assert result.limit() == pytest.approx(np.quantile(true[near], 0.95), rel=0.02)
    text = result.report()
    assert f"f/b < {result.limit():.3g} (95 %)" in text
    assert "galaxies with redshifts below 0.005 left out" in text
    assert result.velocity.unit == "km/s"


def test_what_cannot_be_fitted(clustered, flow):
    population, _, distance = clustered
    field = sim.observe(population, sim.spin((0.0, 0.0, 0.0)), 6, sigma=60.0)
    with pytest.raises(FieldError, match="these have none"):
        growth(replace(field, redshift=None), flow)
    with pytest.raises(DegeneracyError, match="too few for ten parameters"):
        growth(field[:60], flow)
    with pytest.raises(ParameterError, match="a hundred galaxies"):
        flow_of_galaxies(population.lon[:50], population.lat[:50], distance[:50])
    with pytest.raises(ParameterError, match="are wider than the smoothing: take a size of"):
        flow_of_galaxies(population.lon, population.lat, distance, size=16)
    with pytest.raises(ParameterError, match="HEALPix map"):
        flow_of_galaxies(population.lon, population.lat, distance, visible=np.ones(50, bool))


@pytest.mark.slow
def test_intervals_and_limits_hold():
    """200 skies, no flow and flows of two errors: 68 % intervals, 95 % limits."""
    held = []
    for seed in range(100):
        population, grid = sim.clustered_galaxies(6000, seed, size=80)
        distance = transverse_distance(population.redshift) * H
        flow = flow_of_galaxies(population.lon, population.lat, distance, size=64)
        for beta in (0.0, F):
            signal = sim.peculiar(200.0, [seed, 1], flow=grid if beta else None)
            result = growth(sim.observe(population, signal, [seed, 2], sigma=26.0), flow)
            held.append((abs(result.beta[0] - beta) < result.beta[1], result.limit() > beta))
    share = np.mean(held, 0)
    assert 0.62 < share[0] < 0.77
    assert share[1] > 0.93
