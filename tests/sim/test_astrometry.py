"""Variability and five-parameter solutions."""

import numpy as np
import pytest
from conftest import few_or_many
from scipy import stats

import fit
import sim
from fit.secular_parallax import hubble_constant, observer_velocity
from sim.astrometry import KNOT_INTERVAL, PARAMETERS, compute_unit_transit_errors, parallax_error, solve_astrometry
from sim.expected import errors_by_place
from sim.variability import Variability, markov_chain
from vsh.models.cosmology import BACHCHAN_2016
from vsh.tools.errors import ParameterError

LAW = sim.NominalScanningLaw()


def test_chain_has_its_variance_and_its_memory():
    """At irregular times, over many draws: σ² at each, e^{−Δt/τ} between any two, Gaussian."""
    times = np.array([0.0, 0.1, 0.15, 1.0, 3.0, 3.01])
    n = 20_000
    source, all_times = np.repeat(np.arange(n), len(times)), np.tile(times, n)
    x = markov_chain(all_times, 100.0, 2.0, rng=1, source=source).reshape(n, -1)
    np.testing.assert_allclose(x.std(0), 100, rtol=4 / np.sqrt(2 * n))
    expected = np.exp(-np.abs(np.subtract.outer(times, times)) / 2.0)
    np.testing.assert_allclose(np.corrcoef(x.T), expected, atol=4 / np.sqrt(n))
    for column in x.T:
        assert stats.kstest(column / 100, "norm").pvalue > 1e-3


def test_chain_is_its_recursion():
    times, sigma, tau = np.sort(np.random.default_rng(1).uniform(0, 5, 50)), 3.0, 0.7
    x = markov_chain(times, sigma, tau, rng=9)
    g = np.random.default_rng(9).standard_normal(50)
    by_hand = [sigma * g[0]]
    for i in range(1, 50):
        decay = np.exp(-(times[i] - times[i - 1]) / tau)
        by_hand.append(decay * by_hand[-1] + sigma * np.sqrt(1 - decay**2) * g[i])
    np.testing.assert_allclose(x, by_hand, rtol=1e-12)


def test_bad_chains_are_refused():
    with pytest.raises(ValueError, match="must rise"):
        markov_chain([1.0, 0.5], 1.0, 1.0, rng=1)
    with pytest.raises(ValueError, match="tau must be above zero"):
        Variability(100.0, 0.0)
    assert len(markov_chain([], 1.0, 1.0, rng=1)) == 0


@pytest.mark.slow
def test_ratios_to_the_parallax_error_are_the_published_ones():
    unit = compute_unit_transit_errors(LAW, n=20_000)
    np.testing.assert_allclose(unit / unit[2], [0.787, 0.699, 1, 0.556, 0.496], rtol=0.05)


def test_parallax_errors_are_the_published_ones():
    magnitude = np.array([14.0, 17.0, 20.0])
    error = sim.Mission(LAW, "DR4").transit_error(magnitude)
    np.testing.assert_allclose(error * compute_unit_transit_errors(LAW)[2], parallax_error(magnitude, "DR4"))


def one_source(n, lon=1.0, lat=0.4):
    """n copies of a source, as transits of n sources."""
    transits = LAW.transits(lon, lat)
    k = len(transits)
    columns = {
        name: np.tile(getattr(transits, name), n) for name in ("time", "angle", "parallax_factor", "view", "across")
    }
    return type(transits)(source=np.repeat(np.arange(n), k), **columns)


def test_errors_have_the_covariance_that_is_quoted():
    n = 5000
    found = solve_astrometry(one_source(n), np.full(n, 50.0), rng=1)
    measured, quoted = np.cov(found.errors.T), found.covariance[0]
    scale = np.sqrt(np.outer(np.diag(quoted), np.diag(quoted)))
    np.testing.assert_allclose(measured / scale, quoted / scale, atol=4 * np.sqrt(2 / n))
    assert len(PARAMETERS) == 5


@pytest.mark.slow
def test_variability_spreads_motions_as_predicted():
    """A⁺ C A⁺ᵀ to 2 %, and quoted on request."""
    n, variability = 40_000, Variability(100.0, 2.0)
    transits = one_source(n)
    found = solve_astrometry(transits, np.full(n, 1e-3), rng=1, variability=variability)
    few = solve_astrometry(one_source(2), np.full(2, 1e-3), rng=1, variability=variability, quote_variability=True)
    np.testing.assert_allclose(found.errors.std(0), np.sqrt(np.diag(few.covariance[0])), rtol=0.02)
    # The prediction once more, by its definition.
    first = slice(0, len(transits) // n)
    angle, time = transits.angle[first], transits.time[first] - 2.5
    a = np.stack(
        [np.sin(angle), np.cos(angle), transits.parallax_factor[first], time * np.sin(angle), time * np.cos(angle)], 1
    )
    wander = 100.0**2 * np.exp(-np.abs(np.subtract.outer(time, time)) / 2) * np.cos(np.subtract.outer(angle, angle))
    pseudo = np.linalg.pinv(a)
    np.testing.assert_allclose(few.covariance[0], pseudo @ wander @ pseudo.T, rtol=1e-6)


def test_attitude_noise_is_shared():
    """Two sources at one place, without noise of their own, have the same errors."""
    mission = sim.Mission(LAW, attitude=10.0)
    attitude = mission.attitude_noise(2)
    assert attitude.shape == (np.ceil(mission.years / KNOT_INTERVAL) + 1,)
    found = solve_astrometry(one_source(2), np.full(2, 1e-9), rng=1, attitude=attitude)
    np.testing.assert_allclose(found.errors[0], found.errors[1], atol=1e-6)
    assert np.abs(found.errors[0]).max() > 0.1


def test_too_few_transits_are_no_solution():
    transits = one_source(1)
    few = type(transits)(
        *(getattr(transits, name)[:5] for name in ("source", "time", "angle", "parallax_factor", "view", "across"))
    )
    found = solve_astrometry(few, np.ones(1), rng=1)
    assert not found.solved[0]
    field = sim.observe(sim.quasars(3000, 1), sim.spin((0, 0, 0)), 2, mission=sim.NominalScanningLaw(years=0.4))
    assert 0 < len(field) < 3000
    assert f"left out {3000 - len(field)} of 3000 sources: too few transits" in field.notes[-1]
    with pytest.raises(ValueError, match="a longer mission is needed"):
        sim.observe(sim.quasars(10, 1), sim.spin((0, 0, 0)), 2, mission=sim.NominalScanningLaw(years=0.1))


def test_short_way_has_the_errors_of_the_long_one():
    quasars = sim.quasars(2000, rng=1)
    long = sim.observe(quasars, sim.spin((0, 0, 0)), 2, mission=LAW, release="DR4")
    sigma, rho = errors_by_place(quasars.magnitude, quasars.lon, quasars.lat, LAW, release="DR4")
    # Pixels of 3.7° blur the caustics of the scanning law.
    ratio = sigma / long.sigma
    assert abs(np.median(ratio) - 1) < 0.02
    assert np.std(ratio) < 0.2
    assert np.corrcoef(rho, long.rho)[0, 1] > 0.8


def test_positions_and_frames_must_agree():
    population = sim.Population(np.zeros(3), np.zeros(3), np.full(3, 18.0), frame="galactic")
    with pytest.raises(ValueError, match="positions are in galactic, the mission's in icrs"):
        sim.observe(population, sim.spin((0, 0, 0)), 1, mission=LAW)
    with pytest.raises(ValueError, match="variability and excess noise need a mission"):
        sim.observe(sim.quasars(10, 1), sim.spin((0, 0, 0)), 1, variability=Variability(1, 1))


def test_threads_change_nothing():
    quasars, variability = sim.quasars(2500, rng=1), Variability(100.0, 2.0)
    one, four = (
        sim.observe(quasars, sim.spin((1, 2, 3)), 7, mission=LAW, variability=variability, threads=threads)
        for threads in (1, 4)
    )
    for name in ("motion", "sigma", "rho"):
        np.testing.assert_array_equal(getattr(one, name), getattr(four, name))


@pytest.mark.slow
@few_or_many(12, 40)
def test_orientation_from_vlbi(n_skies):
    """Offsets of 300 quasars through the mission: nine parameters, pulls standard normal."""
    quasars = sim.quasars(1500, rng=1)
    vlbi = sim.vlbi_quasars(quasars, 300, rng=2)
    assert np.isin(vlbi.lon, quasars.lon).all()
    truth = np.array([300.0, -200, 100, 5, -4, 3, 0, 6, -2])
    pulls = []
    for seed in range(n_skies):
        motions = sim.observe(
            quasars, sim.spin(truth[3:6]) + sim.acceleration(truth[6:]), [seed, 1], mission=sim.Mission(LAW, attitude=0)
        )
        offsets = sim.observe_offsets(vlbi, sim.spin(truth[:3]), [seed, 2], sim.Mission(LAW, attitude=0), radio=100.0)
        found = fit.solve_frame(motions, offsets)
        pulls.append((found.values - truth) / found.sigma)
    pulls = np.array(pulls)
    assert np.abs(pulls.mean(0)).max() < 4 / np.sqrt(len(pulls))
    assert abs(pulls.std() - 1) < 4 / np.sqrt(2 * pulls.size)


PAPER_A = np.array([0.144, 0.147, 0.159, 0.145, 0.146, 0.159])
PAPER_D = np.array([0.171, 0.167, 0.211, 0.172, 0.167, 0.211])
PAPER_D_TIES = [[0.002, 0.444, -0.330], [-0.444, -0.004, -0.262], [0.328, 0.264, 0.002]]


@pytest.mark.slow
def test_formal_errors_and_correlations_of_the_paper():
    """Cases A and D, from a fifth of their sources; and the galaxies."""
    n, law = 100_000, sim.NominalScanningLaw(dead_time=0.06, rng=3)
    for sky, sigma in (("gums", PAPER_A), ("igql", PAPER_D)):
        field = sim.observe(
            sim.quasars(n, 1, sky), sim.spin((0, 0, 0)), 2, mission=law, release="paper", progress=False
        )
        found = fit.solve_frame(field.to_frame("galactic"))
        np.testing.assert_allclose(found.sigma * np.sqrt(n / 500_000), sigma, rtol=0.15)
        if sky == "igql":
            np.testing.assert_allclose(found.correlation[:3, 3:], PAPER_D_TIES, atol=0.06)
    galaxies = sim.galaxies(n, 1, "gums")
    field = sim.observe(
        galaxies, sim.spin((0, 0, 0)), 2, mission=law, release="paper", progress=False, excess_noise=215.0
    )
    # The paper's errors are without coherent flows.
    found = observer_velocity(field.to_frame("galactic"), 67.3, flows=None)
    np.testing.assert_allclose(found.sigma, [98.7, 97.8, 97.2, 0.27, 0.27, 0.27], rtol=0.15)
    assert hubble_constant(field, BACHCHAN_2016, flows=None).hubble_error == pytest.approx(18.15, rel=0.15)


def test_errors_by_place_need_transits():
    """Of a short mission some places have too few transits for five parameters: no error is made up for them."""
    lon, lat = sim.uniform_sky(200, rng=1)
    with pytest.raises(ParameterError, match="of 200 sources have too few transits"):
        errors_by_place(np.full(200, 18.0), lon, lat, sim.NominalScanningLaw(years=0.3))
