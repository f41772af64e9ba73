"""Velocities of linear theory: published numbers, their correlations by other means, modes against the whole."""

import numpy as np
import pytest

from vsh.models.flows import LINEAR_PLANCK18, LinearTheory, VelocityGrid, flow_modes, read_velocity_grid
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import ParameterError, TableError


def places(n=400, seed=2, near=6.0, far=90.0):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    return lon, lat, np.cbrt(rng.uniform(near**3, far**3, n))


def test_dispersion():
    assert pytest.approx(306.0, abs=0.1) == LINEAR_PLANCK18.sigma


def test_correlations_by_separation():
    along, across = LINEAR_PLANCK18.correlation([5, 10, 20, 40, 80, 120])
    np.testing.assert_allclose(along, [75981, 60171, 38364, 16075, 1609, -2998], atol=2)
    np.testing.assert_allclose(across, [85240, 76494, 62429, 44023, 25567, 16748], atol=2)
    assert [float(each) for each in LINEAR_PLANCK18.correlation(1e5)] == [0, 0]


def test_potential_flow_has_correlations_that_belong_together():
    """Ψ∥ = d(r Ψ⊥)/dr for any power spectrum (Górski 1988)."""
    r = np.linspace(2, 150, 400)
    along, across = LINEAR_PLANCK18.correlation(r)
    slope = np.gradient(r * across, r)
    np.testing.assert_allclose(slope[2:-2], along[2:-2], atol=0.002 * LINEAR_PLANCK18.sigma**2)


def test_power_is_that_of_colossus():
    cosmology = pytest.importorskip("colossus.cosmology.cosmology")
    planck = cosmology.setCosmology("planck18", persistence="")
    k = np.geomspace(1e-4, 10, 300)
    np.testing.assert_allclose(
        LINEAR_PLANCK18.power_at(k), planck.matterPowerSpectrum(k, 0.0, model="eisenstein98"), rtol=1e-3
    )
    assert LINEAR_PLANCK18.growth_rate == pytest.approx(planck.Om0**0.55)


def test_sums_over_waves_have_those_correlations():
    """By drawing plane waves, which share no formula with the spherical ones."""
    rng = np.random.default_rng(1)
    k = np.geomspace(1e-3, 3, 4000)
    weight = LINEAR_PLANCK18.power_at(k) * np.gradient(k)
    waves = rng.choice(k, 400_000, p=weight / weight.sum())
    direction = rng.standard_normal((3, waves.size))
    direction /= np.linalg.norm(direction, axis=0)
    for i, r in enumerate((5.0, 20.0, 60.0)):
        phase = np.cos(waves * direction[2] * r)
        along = 3 * np.mean(direction[2] ** 2 * phase)
        across = 3 * np.mean(direction[0] ** 2 * phase)
        expected = [float(each) / LINEAR_PLANCK18.sigma**2 for each in LINEAR_PLANCK18.correlation(r)]
        np.testing.assert_allclose([along, across], expected, atol=0.01, err_msg=str(i))


def dense(lon, lat, r):
    """The covariance of (east, north, outwards) of all sources, (3n, 3n)."""
    p, q, u = triad(lon, lat)
    n = len(lon)
    full = LINEAR_PLANCK18.covariance(u * r).reshape(n, 3, n, 3)
    axes = np.stack([p, q, u])
    return np.einsum("aim,minj,bjn->ambn", axes, full, axes, optimize=True).reshape(3 * n, 3 * n)


@pytest.mark.parametrize(("n_modes", "bound"), [(250, 0.035), (500, 0.02), (1000, 0.011)])
def test_modes_hold_the_covariance(n_modes, bound):
    lon, lat, r = places()
    modes = flow_modes(5.0, 92.0, n_modes)
    assert 0.93 * n_modes <= len(modes) <= n_modes
    tangential, radial = modes.at(lon, lat, r)
    rows = np.concatenate([tangential[0], tangential[1], radial])
    across, along = modes.left(r)
    found = rows @ rows.T + np.diag(np.concatenate([across, across, along]))
    whole = dense(lon, lat, r)
    n = len(lon)
    for part in (slice(0, 2 * n), slice(2 * n, None)):
        difference = np.linalg.norm(found[part, part] - whole[part, part]) / np.linalg.norm(whole[part, part])
        assert difference < bound
    # Velocities across and along the line of sight belong to one field: their signs would show.
    cross = slice(2 * n, None), slice(0, 2 * n)
    assert np.linalg.norm(found[cross] - whole[cross]) < 1.4 * bound * np.linalg.norm(whole[cross])
    assert np.allclose(np.diag(found), LINEAR_PLANCK18.sigma**2, rtol=0.06)


def test_flow_where_we_are_is_the_limit_of_small_distances():
    modes = flow_modes(2.0, 92.0, 250)
    axes = np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, 0.0, np.pi / 2])
    _, radial = modes.at(*axes, np.full(3, 2.0))
    here = modes.at_origin()
    one = slice(modes.counts[0], modes.counts[0] + 3 * modes.counts[1])
    np.testing.assert_allclose(here[:, one], radial[:, one], atol=0.02 * np.abs(here).max())
    assert not np.delete(here, np.r_[one], axis=1).any()
    variance = 3 / (4 * np.pi) * np.sum(modes.origin**2)
    np.testing.assert_allclose(here @ here.T, variance * np.eye(3), atol=1e-9 * variance)
    assert 0.5 * LINEAR_PLANCK18.sigma**2 < variance < LINEAR_PLANCK18.sigma**2


def test_far_sources_are_left_to_the_dispersion():
    modes = flow_modes(5.0, 90.0, 60)
    tangential, radial = modes.at(np.zeros(1), np.zeros(1), np.array([300.0]))
    assert not tangential.any()
    assert not radial.any()
    assert modes.left(np.array([300.0]))[0][0] == pytest.approx(LINEAR_PLANCK18.sigma**2)


def test_bad_theories_and_modes():
    with pytest.raises(ParameterError, match="rises from above 0"):
        LinearTheory([1, 2, 3], [1, 1, 1], 0.5)
    with pytest.raises(ParameterError, match="above zero at every"):
        LinearTheory(np.arange(1, 10.0), np.r_[np.ones(8), -1], 0.5)


def linear_grid(size=9, half_width=50.0, frame="galactic"):
    """v = (x, 2y, −z) km/s, which linear interpolation holds exactly."""
    x = np.linspace(-half_width, half_width, size)
    grid = np.stack(np.meshgrid(x, x, x, indexing="ij"))
    return VelocityGrid(grid * np.array([1, 2, -1])[:, None, None, None], half_width, frame)


def test_grid_is_interpolated_in_its_own_axes():
    grid = linear_grid()
    lon, lat, r = places(50, far=40.0)
    x, y, z = triad(lon, lat)[2] * r
    velocity, inside = grid.at(lon, lat, r, "galactic")
    np.testing.assert_allclose(velocity, [x, 2 * y, -z], atol=1e-9)
    assert inside.all()
    turn = rotation_matrix("galactic", "icrs")
    turned, _ = grid.at(*angles(turn @ triad(lon, lat)[2]), r, "icrs")
    np.testing.assert_allclose(turned, turn @ velocity, atol=1e-9)
    outside, inside = grid.at(np.zeros(1), np.zeros(1), np.array([60.0]), "galactic")
    assert not inside.any()
    assert not outside.any()


def test_grids_are_written_and_read(tmp_path):
    grid = linear_grid(frame="icrs")
    grid.write(tmp_path / "flow.npz")
    back = read_velocity_grid(tmp_path / "flow.npz")
    np.testing.assert_array_equal(back.velocity, grid.velocity)
    assert (back.half_width, back.frame) == (50.0, "icrs")
    np.save(tmp_path / "flow.npy", grid.velocity)
    assert read_velocity_grid(tmp_path / "flow.npy").half_width == 200.0
    np.save(tmp_path / "bad.npy", np.zeros((3, 4, 5, 6)))
    (tmp_path / "text.npz").write_text("no zip")
    np.savez(tmp_path / "other.npz", x=1)
    damaged = {"bad.npy": "shape", "text.npz": "cannot be read", "other.npz": "lacks", "none.npy": "cannot be read"}
    for name, words in damaged.items():
        with pytest.raises(TableError, match=words):
            read_velocity_grid(tmp_path / name)


@pytest.mark.parametrize(("nearest", "farthest", "n_modes"), [(300, 310, 3), (500, 600, 10), (1, 100, 3), (5, 90, 60)])
def test_bulk_flow_is_always_among_the_modes(nearest, farthest, n_modes):
    """Between far distances a monopole has more power than any dipole: three modes were one, and no bulk flow."""
    modes = flow_modes(nearest, farthest, n_modes)
    assert modes.counts[1] >= 1
    assert len(modes) <= n_modes


@pytest.mark.parametrize(("limits", "options", "words"), [
    ((0.1, 0.01), {}, "must exceed nearest"),
    ((700, 800), {}, "nearest must be below 600"),
    ((5, 90), {"max_degree": -1}, "max_degree"),
    ((5, 90), {"max_degree": "3"}, "max_degree"),
    ((5, 90, 2), {}, "at least 3.*first three are the bulk flow"),
])  # fmt: skip
def test_limits_of_flows_are_checked_as_they_are_given(limits, options, words):
    with pytest.raises(ParameterError, match=words):
        flow_modes(*limits, **options)
