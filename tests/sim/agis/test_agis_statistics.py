"""Errors by magnitude, place and angle: on errors whose correlations are known."""

from itertools import pairwise

import numpy as np
import pytest

import sim
from sim import agis
from sim.variability import Variability, chain_products
from vsh.sky.sphere import triad
from vsh.tools.errors import ParameterError


def test_correlations_of_a_known_field():
    """Errors that are a random glide: their correlation is the cosine of the angle, at every angle."""
    lon, lat = sim.uniform_sky(1500, 1)
    errors = np.random.default_rng(2).standard_normal((4000, 3)) @ triad(lon, lat)[2]
    edges = np.radians([0.0, 2.0, 30.0, 60.0, 90.0, 120.0, 178.0])
    found, pairs = agis.correlation_by_angle(errors, lon, lat, edges)
    middle = [
        np.average(np.cos(angles), weights=np.sin(angles))
        for angles in (np.linspace(low, high, 200) for low, high in pairwise(edges))
    ]
    np.testing.assert_allclose(found, middle, atol=0.02)
    assert pairs.sum() <= 1500 * 1499
    near, counted = agis.correlation_by_angle(errors, lon, lat, np.radians([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(near, 1.0, atol=0.01)
    cosine = np.einsum("ij,ik->jk", triad(lon, lat)[2], triad(lon, lat)[2])[np.triu_indices(1500, 1)]
    assert counted.sum() == np.sum(cosine > np.cos(np.radians(1.0)))


def test_one_draw_needs_its_errors():
    lon, lat = sim.uniform_sky(100, 1)
    errors = np.random.default_rng(1).standard_normal(100)
    with pytest.raises(ParameterError, match="1 draws are too few to estimate the errors"):
        agis.correlation_by_angle(errors, lon, lat, [0.0, 1.0])
    found, _ = agis.correlation_by_angle(errors, lon, lat, [0.0, np.pi], sigma=np.ones(100))
    assert abs(found[0]) < 0.1
    with pytest.raises(ParameterError, match="edges of bins of angle must rise"):
        agis.correlation_by_angle(errors, lon, lat, [1.0, 0.5], sigma=np.ones(100))
    with pytest.raises(ParameterError, match=r"expected \(draws, 100\)"):
        agis.correlation_by_angle(errors[:5], lon, lat, [0.0, 1.0], sigma=np.ones(100))


def test_ratios_by_group():
    rng = np.random.default_rng(1)
    group = np.r_[np.zeros(5000, int), np.full(5000, 2), -1]
    errors = np.r_[2 * rng.standard_normal(5000), 3 * rng.standard_normal(5000), 1e9]
    ratio, counts = agis.error_ratios(errors, np.ones(10_001), group)
    np.testing.assert_allclose(ratio[[0, 2]], [2, 3], rtol=0.03)
    assert np.isnan(ratio[1])
    assert counts.tolist() == [5000, 0, 5000]


def test_products_of_chains_are_those_of_the_dense_covariance():
    rng = np.random.default_rng(1)
    source = np.sort(rng.integers(0, 4, 60))
    times = np.concatenate([np.sort(rng.uniform(0, 5, n)) for n in np.bincount(source)])
    weights = rng.standard_normal((3, 2, 60))
    dense = Variability(1.0, 2.0).covariance(times) * (source[:, None] == source)
    wanted = np.einsum("aik,kl,bil->ab", weights, dense, weights)
    np.testing.assert_allclose(chain_products(weights, source, times, 2.0), wanted, rtol=1e-12)


@pytest.mark.slow
def test_neighbours_share_errors_of_the_attitude():
    """0.16 below 0.1° (scaled: 1°), nothing beyond the field, a little less than nothing at the basic angle.

    In AGISLab's scaling to 5000 sources, where a field is ten times as wide.
    """
    quasars = sim.quasars(5000, 1)
    sigma = sim.Mission(sim.NominalScanningLaw(), "paper").transit_error(quasars.magnitude)
    system, _ = agis.joint_system(sim.NominalScanningLaw(), quasars.lon, quasars.lat, sigma)
    draws = [system.solve(*agis.observations(system.scans, [1, seed]), stop=0.05).sources[:, 2] for seed in range(60)]
    edges = np.radians([0.0, 1.0, 10.0, 20.0, 105.0, 108.0])
    found, _ = agis.correlation_by_angle(draws, quasars.lon, quasars.lat, edges)
    assert found[0] == pytest.approx(0.16, abs=0.02)
    assert abs(found[2]) < 0.005
    assert -0.01 < found[4] < -0.001


def test_each_pair_of_sources_counts_once():
    _, pairs = agis.correlation_by_angle(np.ones(3), [0, 0.5, 1.0], [0, 0, 0.0], [0, 2.0], sigma=np.ones(3))
    assert pairs.tolist() == [3]


def test_sources_without_a_solution_say_nothing_of_a_global_motion():
    """They acted as if they had been seen not to move."""
    from sim.agis._system import System

    quasars = sim.quasars(150, rng=1)
    law = sim.NominalScanningLaw(years=0.6)
    seen = agis.scans(law, quasars.lon, quasars.lat, 100.0, 500.0, knots=2 * 86400.0)
    motion = agis.global_motion(quasars.lon, quasars.lat, 1, scatter=10.0)
    system = System(seen, motion=motion)
    solved = system.solved
    assert 0 < solved.sum() < len(solved)
    few = motion.design[solved], motion.weights[solved]
    information = np.einsum("nik,n,nil->kl", few[0], few[1], few[0])
    assert np.allclose(system.motion.normal, information)
