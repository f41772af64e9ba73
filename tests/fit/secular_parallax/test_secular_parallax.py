from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import few_or_many

import sim
from fit.secular_parallax import DistanceModel, hubble_constant, observer_velocity
from fit.secular_parallax._solution import HubbleSolution, _describe_hubble_limits
from vsh import Field, Vector
from vsh.models.cosmology import BACHCHAN_2016, FlatLCDM, transverse_distance
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, FieldError, ParameterError
from vsh.tools.units import AU_PER_YEAR

VELOCITY = BACHCHAN_2016.to_frame("icrs").value
ACCELERATION = np.array([-0.236, -3.756, -2.080])
SPIN = np.array([0.3, -0.2, 0.5])


def galaxies(n, seed, sigma=2.0, rho=0.5, truth=None, **options):
    population = sim.galaxies(n, rng=seed)
    truth = truth or sim.secular_parallax(VELOCITY, **options) + sim.acceleration(ACCELERATION)
    rng = np.random.default_rng(seed)
    sigma = sigma * np.exp(rng.normal(0, 0.5, (2, n)))
    return sim.observe(population, truth, rng=rng, sigma=sigma, rho=rng.uniform(-rho, rho, n))


def exact(field, truth):
    """The same sources with the true motions."""
    return field.minus(field.motion - truth(field.lon, field.lat, field.redshift))


def test_both_truths_come_out_of_noiseless_motions():
    truth = sim.secular_parallax(VELOCITY, hubble=72.0) + sim.acceleration(ACCELERATION)
    field = exact(galaxies(500, 1), truth)
    found = observer_velocity(field, 72.0)
    np.testing.assert_allclose(found.values, [*VELOCITY, *ACCELERATION], rtol=1e-9)
    assert found.chi2 == pytest.approx(0, abs=1e-6)
    assert found.apex[0] == pytest.approx((263.99, 48.26))
    hubble = hubble_constant(field, VELOCITY)
    assert hubble.hubble == pytest.approx(72.0, rel=1e-9)
    np.testing.assert_allclose(hubble.acceleration.value, ACCELERATION, rtol=1e-9)


def test_sources_move_toward_the_antapex():
    field = Field([0.0], [0.0], np.zeros((2, 1)), np.ones((2, 1)), redshift=[0.01])
    north = sim.secular_parallax((0, 0, 100.0))(field.lon, field.lat, field.redshift)
    assert north[1, 0] < 0
    np.testing.assert_allclose(
        DistanceModel().equations(field).design[:, 2] * 100.0, [north[0, 0], north[1, 0]], atol=1e-15
    )


def test_another_cosmology_changes_the_shape_alone():
    cosmology = FlatLCDM(67.3, 0.2)
    truth = sim.secular_parallax(VELOCITY, cosmology=cosmology, hubble=80.0) + sim.acceleration(ACCELERATION)
    field = exact(galaxies(500, 1), truth)
    np.testing.assert_allclose(observer_velocity(field, 80.0, cosmology=cosmology).velocity.value, VELOCITY, rtol=1e-9)


def design_matrix(field, hubble, peculiar, excess_noise):
    """The same least squares, written out with full 2 × 2 covariances."""
    rate = 1 / (AU_PER_YEAR * transverse_distance(field.redshift, hubble=hubble))
    p, q, _ = triad(field.lon, field.lat)
    normal, rhs = np.zeros((9, 9)), np.zeros(9)
    for i in range(len(field)):
        s1, s2 = field.sigma[:, i]
        c = np.array([[s1**2, field.rho[i] * s1 * s2], [field.rho[i] * s1 * s2, s2**2]])
        c += ((peculiar * rate[i]) ** 2 + excess_noise**2) * np.eye(2)
        rows = np.array([[*(-rate[i] * p[:, i]), *p[:, i], *q[:, i]], [*(-rate[i] * q[:, i]), *q[:, i], *-p[:, i]]])
        normal += rows.T @ np.linalg.solve(c, rows)
        rhs += rows.T @ np.linalg.solve(c, field.motion[:, i])
    return normal, rhs


@pytest.mark.parametrize("seed", range(3))
def test_against_the_plain_design_matrix(seed):
    field = galaxies(150, seed, rho=0.95)
    normal, rhs = design_matrix(field, 70.0, 600.0, 1.5)
    found = observer_velocity(field, 70.0, peculiar_dispersion=600.0, excess_noise=1.5, flows=None)
    six = slice(0, 6)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal[six, six]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.values, np.linalg.solve(normal[six, six], rhs[six]), rtol=1e-9)
    free = observer_velocity(field, 70.0, peculiar_dispersion=600.0, excess_noise=1.5, spin="free", flows=None)
    np.testing.assert_allclose(free.values, np.linalg.solve(normal, rhs), rtol=1e-9)
    np.testing.assert_allclose(free.spin.covariance, np.linalg.inv(normal)[6:, 6:], rtol=1e-9, atol=1e-12)


def test_known_spin_is_taken_away_and_its_errors_carried_on():
    truth = sim.secular_parallax(VELOCITY) + sim.acceleration(ACCELERATION) + sim.spin(SPIN)
    field = exact(galaxies(300, 2), truth)
    known = Vector(SPIN, np.zeros((3, 3)))
    np.testing.assert_allclose(observer_velocity(field, 67.3, spin=known).velocity.value, VELOCITY, rtol=1e-8)
    plain = observer_velocity(field, 67.3, spin=known)
    with_errors = observer_velocity(field, 67.3, spin=Vector(SPIN, 0.04 * np.eye(3)))
    # θ is linear in ω: the covariance by three unit steps.
    spins = [Vector(SPIN + step, np.zeros((3, 3))) for step in np.eye(3)]
    carried = np.stack([observer_velocity(field, 67.3, spin=spin).values - plain.values for spin in spins], 1)
    np.testing.assert_allclose(with_errors.covariance, plain.covariance + 0.04 * carried @ carried.T, rtol=1e-6)
    np.testing.assert_allclose(with_errors.values, plain.values)
    turned = observer_velocity(field, 67.3, spin=known.to_frame("galactic"))
    np.testing.assert_allclose(turned.values, plain.values, rtol=1e-9)
    assert plain.spin is None
    assert plain.chi2 == pytest.approx(0, abs=1e-6)


def test_frame_does_not_matter():
    field = galaxies(400, 3)
    here, there = observer_velocity(field, 67.3), observer_velocity(field.to_frame("galactic"), 67.3)
    np.testing.assert_allclose(there.velocity.value, here.velocity.to_frame("galactic").value, rtol=1e-9)
    assert there.apex[0] == pytest.approx(here.apex[0])
    hubble = hubble_constant(field.to_frame("galactic"), BACHCHAN_2016)
    assert hubble.hubble == pytest.approx(hubble_constant(field, BACHCHAN_2016).hubble)


def test_velocity_and_hubble_are_the_same_product():
    field = galaxies(400, 4)
    options = {"peculiar_dispersion": 0, "flows": None}
    one, two = (observer_velocity(field, hubble, **options) for hubble in (67.3, 134.6))
    np.testing.assert_allclose(one.velocity.value, 2 * two.velocity.value, rtol=1e-9)
    fast, slow = hubble_constant(field, 2 * VELOCITY), hubble_constant(field, VELOCITY)
    assert slow.hubble == pytest.approx(2 * fast.hubble)


def test_errors_of_the_velocity_are_carried_into_hubble():
    field = galaxies(400, 5)
    loose = replace(BACHCHAN_2016, covariance=400.0 * np.eye(3))
    exactly, with_errors = hubble_constant(field, BACHCHAN_2016), hubble_constant(field, loose)

    def with_velocity(off):
        return hubble_constant(field, replace(BACHCHAN_2016, value=BACHCHAN_2016.value + off)).hubble

    scatter = np.linalg.norm([with_velocity(off) - with_velocity(-off) for off in 20 * np.eye(3)]) / 2
    assert with_errors.hubble_error == pytest.approx(np.hypot(exactly.hubble_error, scatter), rel=0.05)
    assert with_errors.hubble_error > exactly.hubble_error


@pytest.mark.slow
@few_or_many(24, 60)
def test_pulls_with_peculiar_velocities(n_skies):
    pulls = []
    for seed in range(n_skies):
        truth = sim.secular_parallax(VELOCITY) + sim.acceleration(ACCELERATION) + sim.peculiar(750.0, rng=1000 + seed)
        field = galaxies(400, seed, sigma=1.0, truth=truth)
        found = observer_velocity(field, 67.3, flows=None)
        pulls.append((found.values - [*VELOCITY, *ACCELERATION]) / found.sigma)
        hubble = hubble_constant(field, BACHCHAN_2016, flows=None)
        pulls[-1] = [*pulls[-1], (hubble.hubble - 67.3) / hubble.hubble_error]
    pulls = np.array(pulls)
    assert np.abs(pulls.mean(0)).max() < 4 / np.sqrt(n_skies)
    assert pulls.std() == pytest.approx(1, abs=3.5 / np.sqrt(2 * pulls.size))
    ignored = observer_velocity(field, 67.3, peculiar_dispersion=0.0, flows=None)
    assert ignored.chi2 / ignored.dof > 1.5


def test_background_as_a_test():
    field = galaxies(2000, 6, sigma=1.0)
    found = observer_velocity(field, 67.3)
    chi2, p = found.against(BACHCHAN_2016)
    assert 0 < chi2 < 20
    assert p > 0.001
    away = replace(BACHCHAN_2016, value=BACHCHAN_2016.value + 10 * np.linalg.norm(found.velocity.sigma))
    assert found.against(away)[1] < 1e-3


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda f: observer_velocity(f), DegeneracyError, r"only the product .* v · H0: give hubble="),
        (lambda f: hubble_constant(f), DegeneracyError, r"only the product"),
        (lambda f: observer_velocity(f, 0.0), ParameterError, "hubble must be above zero, not 0.0"),
        (lambda f: observer_velocity(f, -67.0), ParameterError, "must be (above zero|a finite number)"),
        (lambda f: observer_velocity(f, np.nan), ParameterError, "must be (above zero|a finite number)"),
        (lambda f: hubble_constant(f, (0, 0, 0)), ParameterError, "has no direction"),
        (lambda f: hubble_constant(f, (1, 2)), ParameterError, "three components"),
        (lambda f: hubble_constant(f, "cobe"), ParameterError, "there are planck, paper"),
        (lambda f: observer_velocity(f, 70, peculiar_dispersion=-1), ParameterError, "peculiar_dispersion must be zero or more, not -1"),
        (lambda f: observer_velocity(f, 70, spin="none"), ParameterError, "spin is None, 'free' or a Vector"),
        (lambda f: observer_velocity(f[:2], 70), DegeneracyError, "2 sources cannot separate v_x"),
        (lambda f: observer_velocity(f._derive(redshift=None), 70), FieldError, "no redshifts"),
        (lambda f: observer_velocity(f._derive(redshift=np.full(50, 0.01)), 70), DegeneracyError, "more than one distance"),
        (lambda f: observer_velocity(f._derive(redshift=np.r_[np.nan, 0.0, -1, f.redshift[3:]]), 70), FieldError,
         "3 of 50 redshifts .* 1 missing, 2 zero or negative"),
    ],
)  # fmt: skip
def test_bad_input(call, error, words):
    with pytest.raises(error, match=words):
        call(galaxies(50, 1))


@pytest.mark.parametrize("spin", [None, "free"])
def test_residuals_are_those_of_chi2(spin):
    field = galaxies(300, 3)
    velocity = observer_velocity(field, 67.3, peculiar_dispersion=0.0, spin=spin, flows=None)
    hubble = hubble_constant(field, VELOCITY, peculiar_dispersion=0.0, spin=spin, flows=None)
    for found in (velocity, hubble):
        assert found.residuals(field).chi2.sum() == pytest.approx(found.chi2, rel=1e-9)
    with pytest.raises(FieldError, match="redshift"):
        velocity.model(Field(field.lon, field.lat, field.motion, field.sigma))


def test_limit_of_a_positive_constant_covers_where_noise_makes_the_estimate_negative():
    """Of −37 ± 47 km/s/Mpc the limit was 41, which excluded what the posterior did not."""

    def limits(value, error):
        return HubbleSolution.hubble_limits.fget(SimpleNamespace(hubble=value, hubble_error=error))

    assert limits(-37.3, 47.5) == pytest.approx((0, 71.8), abs=0.1)
    assert limits(70.0, 2.0) == pytest.approx((70 - 1.645 * 2, 70 + 1.645 * 2), abs=0.01)
    draws = np.random.default_rng(1).normal(67.0, 47.5, 2000)
    assert 0.95 <= np.mean([limits(value, 47.5)[1] > 67.0 for value in draws]) < 1


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((14.2, 179.6), "below 179.6 km/s/Mpc with 95 %, above 14.2 with 95 % (one-sided)"),
        ((0.0, 64.2), "below 64.2 km/s/Mpc with 95 %, without a limit from below"),
    ],
)
def test_limits_are_said_where_there_are_some(limits, words):
    """Found by a newcomer: below 0.0 and above 0.0."""
    assert _describe_hubble_limits(*limits) == words


def test_a_speed_that_nobody_has_is_doubted():
    """Redshifts in per cent, or H0 as h, gave 60 000 km/s at p = 1e-170 without a word."""
    fast, slow = (
        observer_velocity(
            sim.observe(sim.galaxies(300, 1), sim.secular_parallax((v, 0, 0)), 1, sigma=1.0), 67.3, flows=None
        )
        for v in (30_000.0, 400.0)
    )
    assert "above 3000 km/s: are redshifts, H0 and motions in the unit" in fast.report()
    assert "in the unit that was taken" not in slow.report()
