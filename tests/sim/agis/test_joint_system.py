"""The laws of the joint solution of sources and attitude, on problems small enough for dense matrices."""

import numpy as np
import pytest

import sim
from sim.agis import System, scaled, scans, start_errors
from sim.agis._system import Iteration

YEARS = 2.0


def make(n=60, knots=3 * 86400.0, across=500.0, **options):
    quasars = sim.quasars(n, 1)
    law = sim.NominalScanningLaw(years=YEARS)
    return System(scans(law, quasars.lon, quasars.lat, 100.0, across, knots=knots), **options)


@pytest.fixture(scope="module", params=[True, False], ids=["compiled", "sparse"])
def system(request):
    return make(compiled=request.param)


def dense(system):
    n = 5 * system.scans.n_sources
    return system.apply(np.eye(n).reshape(-1, 5, n)).reshape(n, n)


def test_six_eigenvalues_are_zero_and_the_seventh_is_not(system):
    matrix = dense(system)
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    values = np.linalg.eigvalsh(matrix)
    assert np.abs(values[:6]).max() < 1e-12 * values[-1]
    assert values[6] > 1e-6 * values[-1]
    one = np.random.default_rng(1).standard_normal((60, 5))
    np.testing.assert_allclose(system.apply(one).ravel(), matrix @ one.ravel(), atol=1e-12)
    null = system.null_space().reshape(6, -1)
    assert np.abs(matrix @ null.T).max() < 1e-9 * np.abs(matrix).max()


def test_adjointness(system):
    rng = np.random.default_rng(1)
    n, k = system.scans.n_sources, len(system.scans)
    x, h = rng.standard_normal((n, 5)), rng.standard_normal((system.coefficients, 3))
    along, across = rng.standard_normal((2, k))
    seen, right = system.predict(x, h), system.adjoint(along, across)
    w = system.scans.weights.astype(np.float32).astype(float)[:, system.scans.source]
    left = np.sum(w[0] * along * seen[0] + w[1] * across * seen[1])
    assert left == pytest.approx(np.sum(right[0] * x) + np.sum(right[1] * h), rel=1e-12)


def test_passes_are_the_blocks_of_the_normal_equations(system):
    """Cᵀ, C, S and A of the passes against the weighted transpose of what they predict."""
    rng = np.random.default_rng(2)
    n = system.scans.n_sources
    x, h = rng.standard_normal((n, 5, 2)), rng.standard_normal((system.coefficients, 3, 2))
    zero = np.zeros((system.coefficients, 3)), np.zeros((n, 5))
    for k in range(2):
        s, c = system.adjoint(*system.predict(x[..., k], zero[0]))
        np.testing.assert_allclose(system.passes.to_attitude(x)[..., k], c, atol=1e-12 * np.abs(c).max())
        np.testing.assert_allclose(np.einsum("nij,nj->ni", system.blocks, x[..., k]), s, atol=1e-11 * np.abs(s).max())
        c, a = system.adjoint(*system.predict(zero[1], h[..., k]))
        np.testing.assert_allclose(system.passes.to_sources(h)[..., k], c, atol=1e-12 * np.abs(c).max())
        bent = np.diff(h[..., k], 2, axis=0) / system.smoothing**2
        for row, factor in enumerate((1, -2, 1)):
            a[row : row + len(bent)] += factor * bent
        np.testing.assert_allclose(system.attitude_of(a), h[..., k], atol=1e-6)


def test_conjugate_gradients_are_the_pseudo_inverse(system):
    rng = np.random.default_rng(3)
    along, across = 100 * rng.standard_normal(len(system.scans)), 500 * rng.standard_normal(len(system.scans))
    found = system.solve(along, across, stop=None, iterations=500)
    right = system.reduce(*system.adjoint(along, across))
    x = np.linalg.pinv(dense(system), rcond=1e-10) @ right.ravel()
    mine, wanted = (system.without_null_space(each.reshape(-1, 5, 1))[0] for each in (found.sources, x))
    np.testing.assert_allclose(mine, wanted, atol=1e-6 * np.sqrt(np.einsum("nii->ni", system.formal))[..., None].min())
    # And the attitude is what belongs to those sources.
    g = system.adjoint(along, across)[1] - system.passes.to_attitude(found.sources[..., None])[..., 0]
    np.testing.assert_allclose(found.attitude, system.attitude_of(g), atol=1e-9)


def test_exact_errors_are_those_of_the_pseudo_inverse(system):
    inverse = np.linalg.pinv(dense(system), rcond=1e-10)
    g = np.random.default_rng(4).standard_normal((60, 5, 2))
    # What the null space does to a functional is left out by the blocks as weights.
    basis = system.null_space().reshape(6, -1)
    weighted = np.einsum("nij,knj->kni", system.blocks, system.null_space()).reshape(6, -1)
    flat = g.reshape(-1, 2)
    flat = flat - weighted.T @ np.linalg.solve(weighted @ basis.T, basis @ flat)
    np.testing.assert_allclose(system.covariance_of(g, tolerance=1e-9), flat.T @ inverse @ flat, rtol=1e-6)


def test_rotation_of_the_truth_changes_no_observation(system):
    rng = np.random.default_rng(5)
    turn = rng.standard_normal(6)
    x = np.einsum("k,kni->ni", turn, system.null_space())
    greville = (np.arange(system.coefficients) - 1) * system.scans.spacing - YEARS / 2
    h = turn[:3] + greville[:, None] * turn[3:]
    seen = system.predict(x, h)
    assert max(np.abs(each).max() for each in seen) < 2e-6 * np.abs(turn).max()  # the design is in single precision


def test_without_noise_the_truth_comes_back_outside_the_null_space(system):
    rng = np.random.default_rng(6)
    n = system.scans.n_sources
    truth = 1e3 * rng.standard_normal((n, 5))
    along, across = system.predict(truth, np.zeros((system.coefficients, 3)))
    start, attitude = start_errors(system.scans, 7)
    for first in ("sources", "attitude"):
        found = system.solve(along, across, start=truth + start, attitude=attitude, first=first, stop=None)
        left, _ = system.without_null_space((found.sources - truth)[..., None])
        assert np.abs(left).max() < 1e-7 * np.abs(start).max(), first


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_change_nothing(threads):
    rng = np.random.default_rng(8)
    one, more = make(threads=1), make(threads=threads)
    along, across = 100 * rng.standard_normal((2, len(one.scans)))
    np.testing.assert_array_equal(one.solve(along, across).sources, more.solve(along, across).sources)


def test_compiled_passes_are_the_sparse_ones():
    compiled, plain = make(compiled=True), make(compiled=False)
    np.testing.assert_allclose(compiled.blocks, plain.blocks, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(compiled.formal_covariance(2), plain.formal_covariance(2), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(compiled.true_covariance(1), plain.true_covariance(1), rtol=1e-5, atol=1e-6)
    seen = 100 * np.random.default_rng(3).standard_normal((2, len(plain.scans)))
    found, expected = (each.solve(*seen).sources for each in (compiled, plain))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-3 * np.std(expected))


def test_formal_covariance_is_that_of_independent_sources(system):
    """By the covariances of `sim.expected`, which follows every source for itself and knows no attitude."""
    import fit

    field = system.solve(*np.zeros((2, len(system.scans)))).field()
    wanted = fit.fit_field(field, 1).covariance
    np.testing.assert_allclose(system.formal_covariance(1), wanted, rtol=1e-6, atol=1e-9)


def test_prior_of_ten_microarcseconds_is_the_shortcut():
    """Sources of 100 µas a transit: an attitude known to 10 µas adds a per cent in quadrature at most."""
    system = make(n=200, knots=86400.0, prior=10.0)
    ratio = np.sqrt(np.diag(system.true_covariance(1, tolerance=1e-6)) / np.diag(system.formal_covariance(1)))
    assert (ratio >= 1).all()
    assert (ratio[3:] < 1.2).all()
    loose = make(n=200, knots=86400.0, prior=1000.0)
    assert (np.diag(loose.true_covariance(1)) > np.diag(system.true_covariance(1)))[3:].all()


def test_running_sums_are_a_lower_bound_that_grows(system):
    from sim.agis import MotionFit
    from vsh import Modes

    g = MotionFit(system, Modes(1), np.arange(60)).functionals([3, 4, 5])
    exact = np.diag(system.covariance_of(g, tolerance=1e-10))
    work, total = Iteration(system, g), np.zeros(3)
    for _ in range(12):
        work.step()
        assert (work.gain >= 0).all()
        total += work.gain
        assert (total <= exact * (1 + 1e-9)).all()
    assert (total > 0.9 * exact).all()


def test_scaled_missions_see_as_much_of_each_source():
    law, knots = scaled(5000)
    assert (law.spin_rate, knots) == pytest.approx((6.0, 3000.0))
    quasars = sim.quasars(300, 1)
    full = sim.NominalScanningLaw().transits(quasars.lon, quasars.lat)
    assert len(law.transits(quasars.lon, quasars.lat)) / len(full) == pytest.approx(1, abs=0.02)
    lossy = sim.NominalScanningLaw(dead_time=0.1, rng=1)
    np.testing.assert_array_equal(scaled(5000, lossy)[0].lost, lossy.lost)
