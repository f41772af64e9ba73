"""The direct frame solver."""

import numpy as np
import pytest
from conftest import random_field, triad

import fit
import sim
from vsh.tools.errors import DegeneracyError, FrameError

TRUTH = np.array([30.0, -20.0, 10.0, 1.0, -2.0, 3.0, 0.0, 4.0, -2.0])


def simulated(seed, n=300):
    population = sim.Population(*sim.plane_avoiding_sky(n, rng=1), None)
    motions = sim.observe(population, sim.spin(TRUTH[3:6]) + sim.acceleration(TRUTH[6:]), seed, sigma=20.0, rho=0.7)
    few = sim.Population(population.lon[:50], population.lat[:50], None)
    offsets = sim.observe(few, sim.spin(TRUTH[:3]), [seed, 1], sigma=[[100.0], [60.0]], rho=-0.5)
    return motions, offsets


def test_as_many_data_as_unknowns_leave_no_residual():
    """Three sources determine spin and acceleration exactly: χ² is zero, and no index is beyond the triangle."""
    field = random_field(3, seed=2)
    found = fit.direct.solve_frame(field)
    assert (found.chi2, found.dof) == (0.0, 0)
    np.testing.assert_allclose(found.model(field), field.motion, atol=1e-8 * np.abs(found.values).max())
    assert found.orientation is None  # without offsets
    assert len(found.names) == 6


def test_nine_parameters_are_weighted_least_squares():
    """All rows at once with their full covariance, by the pseudo-inverse."""
    motions, offsets = simulated(1)
    found = fit.direct.solve_frame(motions, offsets)
    normal, rhs, square = np.zeros((9, 9)), np.zeros(9), 0.0
    for field, columns in ((offsets, slice(0, 3)), (motions, slice(3, 9))):
        for k in range(len(field)):
            p, q, _ = triad(field.lon[k], field.lat[k])
            rows = np.zeros((2, 9))
            rows[:, columns] = [q, -p] if field is offsets else [[*q, *p], [*-p, *q]]
            (s1, s2), rho = field.sigma[:, k], field.rho[k]
            weight = np.linalg.inv([[s1 * s1, rho * s1 * s2], [rho * s1 * s2, s2 * s2]])
            normal += rows.T @ weight @ rows
            rhs += rows.T @ weight @ field.motion[:, k]
            square += field.motion[:, k] @ weight @ field.motion[:, k]
    np.testing.assert_allclose(found.values, np.linalg.solve(normal, rhs), rtol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal), atol=1e-12)
    assert found.chi2 == pytest.approx(square - rhs @ found.values, rel=1e-9)
    assert found.dof == 2 * (300 + 50) - 9
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(np.linalg.inv(normal))), rtol=1e-9)
    assert found.names[:4] == ("epsilon_x", "epsilon_y", "epsilon_z", "omega_x")
    assert found.orientation.unit == "µas"
    np.testing.assert_allclose(found.correlation[:3, 3:], 0, atol=1e-15)


def test_agrees_with_the_harmonics_to_rounding():
    check = fit.cross_check(random_field(5000, seed=2, rho=0.99))
    assert check.largest < 1e-9
    np.testing.assert_allclose(check.frame.spin.covariance, check.harmonics.spin.covariance, rtol=1e-9)
    assert check.frame.chi2 == pytest.approx(check.harmonics.chi2)


def test_many_blocks_are_one_solution(monkeypatch):
    motions, offsets = simulated(3)
    whole = fit.direct.solve_frame(motions, offsets)
    monkeypatch.setattr(fit.direct, "_BLOCK_SIZE", 7)
    np.testing.assert_allclose(fit.direct.solve_frame(motions, offsets).values, whole.values, rtol=1e-10)


def test_degenerate_parameters_are_an_error():
    motions, offsets = simulated(1)
    with pytest.raises(DegeneracyError, match="2 sources cannot separate omega_x"):
        fit.direct.solve_frame(motions[:2])
    with pytest.raises(DegeneracyError, match="widen the sky"):
        fit.direct.solve_frame(motions[[0] * 50])
    with pytest.raises(FrameError, match="motions are in icrs, offsets in galactic"):
        fit.direct.solve_frame(motions, offsets.to_frame("galactic"))
