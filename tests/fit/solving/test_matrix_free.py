"""Solutions without a matrix."""

import numpy as np
import pytest
from conftest import random_field

import fit
import fit.solving.matrix_free
import sim
from vsh import Coefficients, Field, Mode, Modes
from vsh.tools.errors import ConvergenceError, CovarianceError, FieldError
from vsh.transform import synthesis


@pytest.mark.parametrize("lmax", [4, 15])
def test_is_the_dense_solution(lmax):
    field, modes = random_field(5000, seed=lmax), Modes(lmax)
    dense = fit.solve(fit.normal_equations(field, modes, method="design-matrix"))
    asked = [Mode("S", 3, 2), Mode("T", 1, 1, "im")]
    free = fit.solve_matrix_free(field, modes, errors_of=asked, tolerance=1e-11)
    np.testing.assert_allclose(
        free.coefficients.values / dense.sigma, dense.coefficients.values / dense.sigma, atol=1e-8
    )
    assert free.chi2 == pytest.approx(dense.chi2, rel=1e-10)
    for mode in asked:
        assert free.errors[mode] == pytest.approx(dense.sigma[modes.index(mode)], rel=1e-8)
    assert (free.n_data, free.frame) == (10_000, "icrs")
    assert free.residual <= 1e-11


def test_prior_is_the_dense_prior():
    field, modes = random_field(400, seed=1), Modes(8)
    l = np.arange(1, 9)
    power = 1000.0 / l**2
    # Power P_l over 2l + 1 coefficients, those of m > 0 with half the variance and twice the count.
    variance = (power / (2 * l + 1))[modes.degrees - 1] / modes.norm2
    dense = fit.solve(fit.normal_equations(field, modes), prior=fit.gaussian_prior(modes, np.sqrt(variance)))
    for prior in (power, lambda l: 1000.0 / l**2):
        free = fit.solve_matrix_free(field, modes, prior_power=prior, tolerance=1e-11)
        np.testing.assert_allclose(free.coefficients.values, dense.coefficients.values, atol=1e-8)
    with pytest.raises(ValueError, match="prior power must be positive"):
        fit.solve_matrix_free(field, modes, prior_power=0)


def test_missing_attributes_are_named():
    free = fit.solve_matrix_free(random_field(5000, seed=1), Modes(4))
    for name in ("covariance", "sigma", "correlation", "spin", "acceleration"):
        with pytest.raises(CovarianceError, match="has no covariance matrix: ask for the errors of some"):
            getattr(free, name)
    assert free.coefficients.rotation.shape == (3,)
    assert "matrix-free: " in free.notes[-1]


def test_stream_is_read_once():
    field = random_field(5000, seed=2)
    whole = fit.solve_matrix_free(field, Modes(5), tolerance=1e-11)
    stream = (part for part in (field[:1000], field[1000:]))
    np.testing.assert_allclose(
        fit.solve_matrix_free(stream, Modes(5), tolerance=1e-11).coefficients.values,
        whole.coefficients.values,
        atol=1e-8,
    )
    with pytest.raises(FieldError, match="one frame"):
        fit.solve_matrix_free([field, field.to_frame("galactic")], Modes(2))


def simulated(lmax, n, latitude, seed=1):
    rng = np.random.default_rng(seed)
    modes = Modes(lmax)
    truth = Coefficients(modes, rng.normal(size=len(modes)) * 10 / modes.degrees / np.sqrt(modes.norm2))
    lon, lat = sim.plane_avoiding_sky(n, rng, latitude) if latitude else sim.uniform_sky(n, rng)
    sigma = rng.uniform(5, 20, (2, n))
    motion = synthesis(truth, lon, lat) + sigma * rng.standard_normal((2, n))
    return truth, Field(lon, lat, motion, sigma)


def test_empty_band_is_named_or_bridged_by_a_prior():
    truth, field = simulated(60, 30_000, latitude=15)
    with pytest.raises(ConvergenceError, match=r"condition at least .* degrees .* of the sky is empty.*prior_power"):
        fit.solve_matrix_free(field, truth.modes, max_iterations=60, progress=False)
    free = fit.solve_matrix_free(field, truth.modes, prior_power=lambda l: (2 * l + 1) * 100 / l**2)
    away = free.coefficients.values - truth.values
    assert np.mean(away**2) < 0.5 * np.mean(truth.values**2)


@pytest.mark.slow
def test_degree_200_of_a_million_sources():
    truth, field = simulated(200, 1_000_000, latitude=0)
    asked = [Mode("S", 1, 0), Mode("T", 100, 50), Mode("S", 200, 200, "im")]
    free = fit.solve_matrix_free(field, truth.modes, errors_of=asked)
    pulls = [(free.coefficients.values - truth.values)[truth.modes.index(m)] / free.errors[m] for m in asked]
    assert np.abs(pulls).max() < 4
    # χ² of 2n − p degrees of freedom.
    assert abs(free.chi2 / free.dof - 1) < 5 * np.sqrt(2 / free.dof)


def test_condition_is_that_of_the_preconditioned_matrix():
    """Extreme eigenvalues of the dense matrix, by operating on unit vectors."""
    field = random_field(900, 3)
    modes = Modes(14)
    solution = fit.solve_matrix_free(field, modes, prior_power=1e3, tolerance=1e-12, progress=False)
    system = fit.solving.matrix_free._System(field, modes, 1e3, None)
    unit = np.eye(len(modes))
    dense = np.stack([system.precondition(system.apply(row)) for row in unit], axis=1)
    values = np.sort(np.linalg.eigvals(dense).real)
    assert solution.condition == pytest.approx(values[-1] / values[0], rel=0.05)
