"""Flows that galaxies share as unknowns: against dense covariances, and on skies that were drawn with them."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many

import sim
from fit.posterior import sample
from fit.secular_parallax import DistanceModel, hubble_constant, observer_velocity
from vsh import Vector
from vsh.io.parts import as_parts
from vsh.models.cosmology import BACHCHAN_2016, FLAT_PLANCK13, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18 as THEORY
from vsh.models.flows import VelocityGrid
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import ParameterError
from vsh.tools.units import AU_PER_YEAR

OURS = BACHCHAN_2016.to_frame("icrs").value
ACCELERATION = np.array([-0.236, -3.756, -2.080])
LITTLE_H = FLAT_PLANCK13.H0.value / 100


def galaxies(n=400, seed=1, hubble=67.3, sigma=2.0, **flow):
    truth = sim.secular_parallax(OURS, hubble=hubble) + sim.acceleration(ACCELERATION)
    if flow:
        truth += sim.peculiar(150.0, [seed, 3], hubble=hubble, **flow)
    return sim.observe(sim.galaxies(n, seed), truth, [seed, 2], sigma=sigma, rho=0.3)


def without_noise(field, hubble):
    truth = sim.secular_parallax(OURS, hubble=hubble) + sim.acceleration(ACCELERATION)
    return field.minus(field.motion - truth(field.lon, field.lat, field.redshift))


def test_schur_complement_is_the_dense_covariance_of_the_modes():
    field = galaxies(500)
    found = observer_velocity(field, 67.3, flows="linear", n_modes=475)
    rows = DistanceModel(flows="linear", n_modes=475).equations(field)
    n = len(field)
    columns = rows.flow.columns(slice(0, n))
    covariance = columns @ columns.T + np.diag(rows.variance + rows.left + (150 * rows.rate) ** 2)
    design = rows.design[:, :6]
    solved = np.linalg.solve(covariance, np.column_stack([design, rows.motion]))
    normal, rhs = design.T @ solved[:, :6], design.T @ solved[:, 6]
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal), rtol=1e-10, atol=1e-10 * found.covariance.max())
    np.testing.assert_allclose(found.values, np.linalg.solve(normal, rhs), rtol=1e-8)
    assert found.chi2 == pytest.approx(rows.motion @ solved[:, 6] - found.values @ rhs, rel=1e-9)
    # The flow that was found is the mean of the modes given the motions.
    residual = rows.motion - design @ found.values
    expected = columns.T @ np.linalg.solve(covariance, residual)
    np.testing.assert_allclose(found.flow.values, expected, rtol=1e-7, atol=1e-9)


def test_velocity_errs_as_under_the_whole_covariance():
    field = galaxies(400)
    p, q, u = triad(field.lon, field.lat)
    r = transverse_distance(field.redshift) * LITTLE_H
    found = observer_velocity(field, 67.3, flows="linear")
    rows = DistanceModel(flows="linear", n_modes=3).equations(field)
    n = len(field)
    full = THEORY.covariance(u * r).reshape(n, 3, n, 3)
    flow = rows.flow
    axes = np.stack([flow.cos * p + flow.sin * q, flow.cos * q - flow.sin * p])
    covariance = np.einsum("aim,minj,bjn->ambn", axes, full, axes, optimize=True).reshape(2 * n, 2 * n)
    covariance *= np.outer(rows.rate, rows.rate)
    covariance += np.diag(rows.variance + (150 * rows.rate) ** 2)
    design = rows.design[:, :6]
    exact = np.linalg.inv(design.T @ np.linalg.solve(covariance, design))
    ratio = np.sqrt(np.diag(found.covariance)[:3] / np.diag(exact)[:3])
    np.testing.assert_allclose(ratio, 1, atol=0.01)


def test_prior_variances_weigh_and_are_no_ruler():
    """H0 comes from the dipole alone: other sizes of the flow shift its expectation by nothing."""
    field = galaxies(500, hubble=90.0)
    exact = without_noise(field, 90.0)
    assert hubble_constant(exact, OURS, flows="linear").hubble == pytest.approx(90.0, rel=1e-9)
    assert hubble_constant(exact, OURS, flows="linear", hubble=30.0).hubble == pytest.approx(90.0, rel=1e-9)
    np.testing.assert_allclose(observer_velocity(exact, 90.0, flows="linear").values, [*OURS, *ACCELERATION], rtol=1e-7)


def from_modes(field, rng, hubble):
    """Motions with a flow of the fit's own modes, what they leave, and 150 km/s; and the flow where we are."""
    rows = DistanceModel(flows="linear", n_modes=120).equations(field)
    n = len(field)
    amplitude = rng.standard_normal(len(rows.modes))
    tangential, _ = rows.modes.at(field.lon, field.lat, rows.flow.distance)
    left = np.sqrt(rows.modes.left(rows.flow.distance)[0] + 150.0**2)
    velocity = tangential @ amplitude + left * rng.standard_normal((2, n))
    truth = sim.secular_parallax(OURS, hubble=hubble) + sim.acceleration(ACCELERATION)
    d = transverse_distance(field.redshift, hubble=hubble)
    motion = truth(field.lon, field.lat, field.redshift) + velocity / (AU_PER_YEAR * d)
    motion += field.sigma * rng.standard_normal((2, n))
    return replace(field, motion=motion), rows.modes.at_origin() @ amplitude


@pytest.mark.slow
@few_or_many(30, 80)
def test_pulls_on_skies_drawn_from_the_modes(n_skies):
    still = galaxies(300, sigma=1.0)
    still = replace(still, rho=np.zeros(len(still)))
    rng = np.random.default_rng(4)
    chi2, plain, h0 = [], [], []
    for _ in range(n_skies):
        field, _ = from_modes(still, rng, 67.3)
        found = observer_velocity(field, 67.3, flows="linear", n_modes=120)
        off = found.values[:3] - OURS
        chi2.append(off @ np.linalg.solve(found.covariance[:3, :3], off))
        alone = observer_velocity(field, 67.3, peculiar_dispersion=306.0, flows=None)
        off = alone.values[:3] - OURS
        plain.append(off @ np.linalg.solve(alone.covariance[:3, :3], off))
        h = hubble_constant(field, OURS, flows="linear", n_modes=120)
        h0.append((h.hubble - 67.3) / h.hubble_error)
    assert np.mean(chi2) == pytest.approx(3, abs=4 * np.sqrt(6 / n_skies))
    assert np.mean(plain) > 2 * np.mean(chi2)
    assert np.std(h0) == pytest.approx(1, abs=3.2 / np.sqrt(2 * n_skies))


@pytest.mark.slow
@pytest.mark.parametrize("hubble", [pytest.param(67.3, marks=pytest.mark.slow), 110.0])
def test_local_group_leads_back_to_no_assumed_hubble_constant(hubble):
    still = galaxies(300, sigma=1.0)
    rng = np.random.default_rng(8)
    pulls, errors = [], []
    for _ in range(80):
        field, here = from_modes(still, rng, hubble)
        group = Vector(here + 150 * rng.standard_normal(3), 1e-6 * np.eye(3), "icrs", "km/s")
        # Weights stand for 67.3 whatever H0 is: that number must not come back.
        with_group = hubble_constant(field, OURS, flows="linear", n_modes=120, local_group=group)
        without = hubble_constant(field, OURS, flows="linear", n_modes=120)
        pulls.append((with_group.hubble - hubble) / with_group.hubble_error)
        errors.append(with_group.hubble_error / without.hubble_error)
    assert abs(np.mean(pulls)) < 4 / np.sqrt(80)
    # Weights for 67.3 are those of flows and velocities that are too small where H0 is 110.
    assert np.std(pulls) == pytest.approx(1 if hubble == 67.3 else 1.3, abs=0.3)
    assert np.mean(errors) < 0.95


def test_known_glide_is_data():
    field = galaxies(400, flow="linear", n_modes=100)
    known = Vector(ACCELERATION, 0.1**2 * np.eye(3))
    loose = Vector(ACCELERATION, 1e6 * np.eye(3))
    tight = Vector(ACCELERATION, 1e-10 * np.eye(3)).to_frame("galactic")
    free, given, nothing = (
        observer_velocity(field, 67.3, flows="linear", acceleration=each) for each in (None, known, loose)
    )
    assert (given.velocity.sigma < free.velocity.sigma).all()
    np.testing.assert_allclose(nothing.values, free.values, rtol=1e-3, atol=1e-3)
    held = observer_velocity(field, 67.3, acceleration=tight).acceleration
    np.testing.assert_allclose(held.value, ACCELERATION, atol=1e-4)


def test_flow_of_a_field_whose_spin_is_known():
    """What is known is taken out of the motions: the flow is that of the field without it."""
    field = galaxies(300, flow="linear", n_modes=60)
    known, none = (Vector(value, 1e-12 * np.eye(3)) for value in ((3.0, -5.0, 2.0), (0, 0, 0)))
    turned = replace(field, motion=field.motion + sim.spin(known.value)(field.lon, field.lat))
    flows = [
        observer_velocity(each, 67.3, flows="linear", spin=spin).flow for each, spin in ((field, none), (turned, known))
    ]
    np.testing.assert_allclose(flows[1].values, flows[0].values, atol=1e-4 * np.abs(flows[0].values).max())


@pytest.mark.slow
def test_reconstruction_lowers_the_errors_and_they_hold():
    """The flow is known but for half of it: errors are smaller, and pulls one."""
    still = galaxies(300, sigma=1.0)
    rng = np.random.default_rng(3)
    chi2, gain = [], []
    x = np.linspace(-150, 150, 31)
    cube = np.stack(np.meshgrid(x, x, x, indexing="ij")).reshape(3, -1)
    far = np.linalg.norm(cube, axis=0)
    rows = DistanceModel(flows="linear", n_modes=120).equations(still)
    p, q, u = triad(*angles(cube))
    tangential, radial = rows.modes.at(*angles(cube), np.maximum(far, 1.0))
    distance = transverse_distance(still.redshift)
    for _ in range(40):
        known, unknown = np.sqrt([[0.75], [0.25]]) * rng.standard_normal((2, len(rows.modes)))
        east, north = tangential @ known
        grid = VelocityGrid((east * p + north * q + (radial @ known) * u).reshape(3, 31, 31, 31), 150.0, "icrs")
        across, _ = rows.modes.at(still.lon, still.lat, rows.flow.distance)
        # What the modes leave is half known as well.
        left = np.sqrt(0.25 * rows.modes.left(rows.flow.distance)[0] + 150.0**2)
        velocity = across @ unknown + left * rng.standard_normal((2, len(still)))
        found, _ = grid.at(still.lon, still.lat, rows.flow.distance, "icrs")
        e, n, _ = triad(still.lon, still.lat)
        velocity = velocity + np.stack([np.sum(found * e, 0), np.sum(found * n, 0)])
        truth = sim.secular_parallax(OURS) + sim.acceleration(ACCELERATION)
        motion = truth(still.lon, still.lat, still.redshift) + velocity / (AU_PER_YEAR * distance)
        motion += still.sigma * rng.standard_normal((2, len(still)))
        field = replace(still, motion=motion, rho=np.zeros(len(still)))
        options = {"flows": "linear", "n_modes": 120}
        with_grid = observer_velocity(field, 67.3, **options, reconstruction=grid, reconstruction_error=0.5)
        off = with_grid.values[:3] - OURS
        chi2.append(off @ np.linalg.solve(with_grid.covariance[:3, :3], off))
        gain.append(with_grid.velocity.sigma.mean() / observer_velocity(field, 67.3, **options).velocity.sigma.mean())
    assert np.mean(chi2) == pytest.approx(3, abs=4 * np.sqrt(6 / 40))
    assert np.mean(gain) < 0.75


def test_flow_is_a_result():
    field = galaxies(2000, sigma=0.2, flow="linear", n_modes=60)
    found = observer_velocity(field, 67.3, flows="linear", n_modes=120)
    assert 0 < found.cosmic_share < 1
    first = found.report().splitlines()[2]
    assert f"{100 * found.cosmic_share:.0f} % of the error's variance is due to coherent flows" in first
    bulk = found.flow.bulk(40.0)
    # A mean over the shell, summed over directions.
    lon, lat = sim.uniform_sky(40_000, 1)
    p, q, u = triad(lon, lat)
    (east, north), radial = found.flow.at(lon, lat, np.full(lon.size, 40.0))
    np.testing.assert_allclose(
        bulk.value, np.mean(east * p + north * q + radial * u, 1), atol=0.02 * found.flow.modes.theory.sigma
    )
    assert "distance [Mpc]" in found.flow.report()
    assert (np.diag(found.flow.covariance) < 1.0 + 1e-9).all()
    plain = observer_velocity(field, 67.3, flows=None)
    assert plain.cosmic_share is None
    assert "without coherent flows" in plain.report().splitlines()[2]


def test_distances_in_mpc_tell_v_and_not_v_h0():
    field = galaxies(600, hubble=90.0)
    exact = without_noise(field, 90.0)
    d = transverse_distance(field.redshift, hubble=90.0)
    own = np.where(np.arange(600) < 200, d, np.nan)
    exact = replace(exact, distance=own, distance_error=1e-4 * own)
    np.testing.assert_allclose(observer_velocity(exact, 90.0).values, [*OURS, *ACCELERATION], rtol=1e-5)
    assert hubble_constant(exact, OURS).hubble == pytest.approx(90.0, rel=1e-5)
    only = exact[:200]
    np.testing.assert_allclose(observer_velocity(only, 50.0).velocity.value, OURS, rtol=1e-5)  # whatever H0 is
    with pytest.raises(ParameterError, match="200 sources have distances in Mpc"):
        sample(exact, n_samples=1000, progress=False)


def test_parts_and_frames_change_nothing():
    field = galaxies(500, flow="linear", n_modes=60)
    one = observer_velocity(field, 67.3, flows="linear", n_modes=60)
    two = observer_velocity(as_parts([field[:100], field[100:]]), 67.3, flows="linear", n_modes=60)
    np.testing.assert_allclose(one.values, two.values, rtol=1e-9, atol=1e-9)
    there = observer_velocity(field.to_frame("galactic"), 67.3, flows="linear", n_modes=60)
    np.testing.assert_allclose(there.velocity.to_frame("icrs").value, one.velocity.value, rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"flows": "linear", "peculiar_dispersion": 750.0}, "a dispersion of 750 km/s counts them twice"),
        ({"flows": "quadratic"}, 'flows are "linear"'),
        ({"flows": "linear", "n_modes": 2}, "first three are the bulk flow"),
        ({"reconstruction": 3, "flows": None}, "does not go with flows=None"),
        ({"flows": "linear", "reconstruction": 3}, "is a vsh.models.flows.VelocityGrid"),
        ({"acceleration": (1, 2, 3)}, "is a Vector with its covariance"),
        ({"acceleration": Vector([1, 2, 3], np.zeros((3, 3)))}, "needs errors"),
        ({"colour": 1}, "no argument is called colour"),
    ],
)
def test_bad_flows(options, words):
    with pytest.raises(ParameterError, match=words):
        observer_velocity(galaxies(60), 67.3, **options)


def test_local_group_needs_a_flow():
    with pytest.raises(ParameterError, match="needs galaxies with a flow"):
        hubble_constant(galaxies(60), "planck", local_group=True, flows=None)
    with pytest.raises(ParameterError, match="is a Vector in km/s"):
        hubble_constant(galaxies(60), "planck", local_group=3, flows="linear", n_modes=9)


def seen(n):
    signal = sim.secular_parallax((-358, 77, -45))
    return sim.observe(sim.galaxies(n, 5), signal, 6, sigma=0.5, redshifts="heliocentric")


@pytest.mark.parametrize("error", [0.012, 0.05, 0.3, 50.0])
def test_one_wrong_redshift_error_moves_nothing(error):
    """A source that is put far away outweighed all others: 1.7 errors in v, and smaller errors."""
    field = seen(400)
    usual = np.full(len(field), 1e-4)
    row = int(np.argmin(np.abs(field.redshift - 0.02)))
    wrong = usual.copy()
    wrong[row] = error
    options = {"flows": None, "peculiar_dispersion": 300.0}
    before, after = (observer_velocity(replace(field, redshift_error=each), 67.3, **options) for each in (usual, wrong))
    moved = np.abs(after.velocity.value - before.velocity.value) / before.velocity.sigma
    assert moved.max() < 0.2
    np.testing.assert_allclose(after.velocity.sigma, before.velocity.sigma, rtol=0.02)
    assert any("1 of 400" in str(note) and "error above 0.5 of it" in str(note) for note in after.notes)


def test_hubble_constant_of_an_observer_in_the_flow_is_warned_of():
    field = seen(200)
    options = {"n_modes": 30}
    assert any("too low" in str(note) for note in hubble_constant(field, "planck", **options).notes)
    for silent in ({"local_group": True}, {"redshift_frame": "true"}, {"flows": None}):
        notes = hubble_constant(field, "planck", **options | silent).notes
        assert not any("too low" in str(note) for note in notes)
