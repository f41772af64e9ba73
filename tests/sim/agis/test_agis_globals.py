"""Motions that follow a global field inside the joint solution."""

import numpy as np
import pytest

import sim
from sim import agis
from vsh.tools.errors import ParameterError

LAW = sim.NominalScanningLaw(years=2.0)


def test_global_motions_are_found_inside_the_solution():
    """A glide of the truth comes back as parameters, and their errors are the exact ones."""
    quasars = sim.quasars(300, 1)
    scans = agis.scans(LAW, quasars.lon, quasars.lat, 100.0, 500.0, knots=86400.0)
    motion = agis.global_motion(quasars.lon, quasars.lat, 1, scatter=10.0)
    system = agis.System(scans, motion=motion)
    truth = sim.acceleration((300.0, -100.0, 50.0))(quasars.lon, quasars.lat, None)
    x = np.zeros((300, 5))
    x[:, 3:] = truth.T
    seen = system.predict(x, np.zeros((system.coefficients, 3)))
    own, noise = np.random.default_rng(1), []
    formal, true = system.global_covariances(tolerance=1e-6)
    assert (np.diag(true)[3:] > np.diag(formal)[3:]).all()
    exact = np.sqrt(np.diag(true))[3:]
    wanted = (motion.functional(3) * x).sum(), (motion.functional(4) * x).sum(), (motion.functional(5) * x).sum()
    for seed in range(12):
        drawn = np.zeros((300, 5))
        drawn[:, 3:] = 10.0 * own.standard_normal((300, 2))
        more = system.predict(drawn, np.zeros((system.coefficients, 3)))
        observed = agis.observations(scans, seed)
        found = system.solve(*(a + b + c for a, b, c in zip(observed, seen, more, strict=True)), stop=1e-4)
        noise.append((found.global_parameters[3:] - wanted) / exact)
    assert 0.5 < np.mean(np.square(noise)) < 1.8  # 36 numbers: 1 ± 0.24


@pytest.mark.parametrize("first", ["sources", "attitude"])
def test_a_solution_with_a_global_motion_forgets_its_start(first):
    quasars = sim.quasars(100, 1)
    scans = agis.scans(LAW, quasars.lon, quasars.lat, 100.0, 500.0, knots=5 * 86400.0)
    system = agis.System(scans, motion=agis.global_motion(quasars.lon, quasars.lat, 1, scatter=10.0))
    seen = agis.observations(scans, 1)
    start, attitude = agis.start_errors(scans, 3, random=1e3, systematic=1e3)
    options = {"stop": None, "iterations": 2000, "first": first}
    zero, other = system.solve(*seen, **options), system.solve(*seen, start=start, attitude=attitude, **options)
    left, _ = system.without_null_space((other.sources - zero.sources)[..., None])
    assert np.abs(left).max() < 1e-3 * np.abs(zero.sources).max()


def test_global_motions_spare_free_sources_and_rotations():
    quasars, stars = sim.quasars(150, 1), sim.stars(150, 2)
    lon, lat = np.r_[quasars.lon, stars.lon], np.r_[quasars.lat, stars.lat]
    scatter = np.r_[np.full(150, 5.0), np.full(150, np.inf)]
    scans = agis.scans(LAW, lon, lat, 100.0, 500.0, knots=86400.0)
    turning = agis.System(scans, motion=agis.global_motion(lon, lat, 2, scatter=scatter))
    fixed = agis.System(scans, motion=agis.global_motion(lon, lat, 2, scatter=scatter, spin=False))
    assert (turning.defect, fixed.defect) == (6, 3)
    spin = np.moveaxis(turning.null_space()[3:], 0, -1)
    # To the single precision of the directions.
    assert np.abs(turning.apply(spin)).max() < 1e-6 * np.abs(turning.blocks).max()
    assert np.abs(fixed.apply(spin)).max() > 1e-2 * np.abs(fixed.blocks).max()
    # The preconditioner is the inverse of what it stands for: sources, and what holds their motions.
    r = np.random.default_rng(3).standard_normal((300, 5, 2))
    z = turning.precondition(r)
    back = turning.blocks @ z
    back[:, 3:] += turning.motion.weights[:, None, None] * z[:, 3:] - turning.motion.pull(z)
    np.testing.assert_allclose(back, r, atol=1e-9 * np.abs(r).max())
    with pytest.raises(ParameterError, match="scatters of motions are zero or negative"):
        agis.global_motion(lon, lat, scatter=0.0)
    with pytest.raises(ParameterError, match="a global motion of 2 sources, and scans of 300"):
        agis.System(scans, motion=agis.global_motion(lon[:2], lat[:2]))
    with pytest.raises(ParameterError, match="no global parameters"):
        agis.System(scans).global_covariances()
