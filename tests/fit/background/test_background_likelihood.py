"""The likelihood of backgrounds, against the dense one of all 2N motions; posteriors against sums over them."""

from dataclasses import replace

import numpy as np
import pytest
from amplitudes import covariance_of
from amplitudes import fit_amplitudes as fit_background
from conftest import random_field
from scipy.integrate import quad

import fit
import sim
from fit.background import Spectrum
from fit.background._amplitude import compute_posteriors_and_evidence
from fit.background._likelihood import Likelihood, Maximum
from vsh import Field, Modes
from vsh.basis import harmonics
from vsh.models.covariance import of_errors
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError

FIELD, MODES = random_field(150, seed=1), Modes(4)
SPECTRA = [Spectrum.waves(hubble=70), Spectrum.odd()]


def dense(field, amplitudes, noise_scale, spectra=SPECTRA, modes=MODES):
    """ln of the Gaussian of all motions, degree 1 with a flat prior marginalised: the 2N × 2N matrix and nothing else."""
    rows = harmonics(field.lon, field.lat, modes).reshape(len(modes), -1).T
    covariance = noise_scale**2 * of_errors(field).matrix
    for amplitude, spectrum in zip(amplitudes, spectra, strict=True):
        covariance = covariance + amplitude * rows @ np.diag(spectrum.variances(modes) * (modes.degrees > 1)) @ rows.T
    first, inverse, y = rows[:, modes.degrees == 1], np.linalg.inv(covariance), field.motion.ravel()
    inner = first.T @ inverse @ first
    projected = inverse - inverse @ first @ np.linalg.solve(inner, first.T @ inverse)
    return -(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1] + y @ projected @ y) / 2


def test_plane_of_two_fields_is_the_tensor():
    """Fields that share no coefficient have a closed form, the same as each point by itself."""
    likelihood = Likelihood(fit.normal_equations(FIELD, MODES), [Spectrum.odd(), Spectrum.even()], [2, 3, 4], [1])
    roots = [np.array([0.0, 0.3, 2.0]), np.array([0.0, 1.0, 5.0, 40.0])]
    expected = [[likelihood.parts(np.array([a * a, b * b])) for b in roots[1]] for a in roots[0]]
    np.testing.assert_allclose(likelihood.on_tensor(roots), np.moveaxis(expected, -1, 0), rtol=1e-11, atol=1e-11)


CASES = [((0.1, 3.0), 1.2), ((0.0, 50.0), 0.9), ((1.0, 0.0), 2.0), ((0.02, 200.0), 1.0)]


@pytest.mark.parametrize(("amplitudes", "noise_scale"), CASES)
def test_likelihood_is_the_dense_one(amplitudes, noise_scale):
    likelihood = Likelihood(fit.normal_equations(FIELD, MODES), SPECTRA, (2, 3, 4), (1,))
    expected = dense(FIELD, amplitudes, noise_scale) - dense(FIELD, (0, 0), 1)
    assert likelihood(amplitudes, noise_scale) == pytest.approx(expected, abs=1e-9)
    alone = dense(FIELD, amplitudes, 1) - dense(FIELD, (0, 0), 1)
    assert likelihood.log_likelihood(np.array(amplitudes)) == pytest.approx(alone, abs=1e-9)


def test_one_free_degree_is_a_degree():
    one, several = (fit_background(fit.normal_equations(FIELD, MODES), SPECTRA, free=free) for free in (1, (1,)))
    np.testing.assert_array_equal(one.amplitudes, several.amplitudes)


def test_fewer_sources_than_coefficients():
    """20 sources, 96 coefficients: the normal matrix is singular, the likelihood is the dense one."""
    field, modes = random_field(20, seed=2), Modes(6)
    likelihood = Likelihood(fit.normal_equations(field, modes), SPECTRA, range(2, 7), (1,))
    expected = dense(field, (0.3, 10.0), 1.1, modes=modes) - dense(field, (0, 0), 1, modes=modes)
    assert likelihood((0.3, 10.0), 1.1) == pytest.approx(expected, abs=1e-8)
    found = fit.background.floor(fit.normal_equations(field, modes))
    assert np.isfinite([found.odd, found.even, found.parity_p_value]).all()
    solution = fit.solve(fit.normal_equations(field, modes), floor=found)
    assert np.isfinite(solution.sigma).all()
    assert solution.without_prior is None


def test_one_spectrum_by_its_eigenvalues_is_the_same():
    normal = fit.normal_equations(FIELD, MODES)
    both, one = Likelihood(normal, SPECTRA, (2, 3, 4), (1,)), Likelihood(normal, SPECTRA[:1], (2, 3, 4), (1,))
    for omega in (0.0, 0.01, 3.0):
        assert one((omega,), 1.3) == pytest.approx(both((omega, 0.0), 1.3), abs=1e-9)


@pytest.fixture(scope="module")
def loud():
    """A sky with systematics that are seen."""
    signal = sim.systematics(30 * Spectrum.odd() + 100 * Spectrum.even(), 3, lmax=4)
    field = sim.observe(sim.quasars(3000, 1), signal, 2, sigma=60.0)
    return fit.normal_equations(field, 4)


def test_maximum_is_the_highest_point(loud):
    likelihood = Likelihood(loud, [Spectrum.odd(), Spectrum.even()], (2, 3, 4), (1,))
    best = likelihood.find_maximum()
    ratios = best.amplitudes / best.noise_scale**2
    top = likelihood.profile_log_likelihood(ratios) + likelihood.chi2 / 2
    assert (best.amplitudes > 0).all()
    for factor in (0.9, 0.99, 1.01, 1.1):
        for k in (0, 1):
            moved = np.array(ratios)
            moved[k] *= factor
            assert likelihood.profile_log_likelihood(moved) + likelihood.chi2 / 2 < top
    assert likelihood(best.amplitudes, best.noise_scale) == pytest.approx(top, abs=1e-9)
    assert likelihood(best.amplitudes, 1.01 * best.noise_scale) < top


def test_information_is_the_mean_curvature():
    """The expected information against second differences of the likelihood, averaged over skies of its own model."""
    modes = Modes(4)
    normal = fit.normal_equations(random_field(400, seed=9), modes)
    spectra, truth = [Spectrum.odd(), Spectrum.even()], np.array([600.0, 300.0])
    root = np.linalg.cholesky(normal.matrix)
    sigma = np.sqrt(sum(a * s.variances(modes) for a, s in zip(truth, spectra, strict=True)))
    rng, steps, curvature = np.random.default_rng(1), np.array([30.0, 15.0, 0.02]), []
    for _ in range(60):
        c, e = sigma * rng.normal(size=len(modes)), rng.normal(size=len(modes))
        chi2 = e @ e + rng.chisquare(800 - len(modes)) + 2 * c @ root @ e + c @ normal.matrix @ c
        likelihood = Likelihood(
            replace(normal, rhs=normal.matrix @ c + root @ e, chi2_null=chi2), spectra, (2, 3, 4), (1,)
        )

        def at(x, likelihood=likelihood):
            return likelihood(x[:2], np.sqrt(x[2]))

        centre, found = np.r_[truth, 1.0], np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                one, two = np.eye(3)[i] * steps, np.eye(3)[j] * steps
                found[i, j] = (at(centre + one + two) - at(centre + one - two) - at(centre - one + two)
                               + at(centre - one - two)) / (4 * steps[i] * steps[j])  # fmt: skip
        curvature.append(-found)
    expected = np.linalg.inv(covariance_of(likelihood, Maximum(truth, 1.0, 0.0)))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.mean(curvature, 0) / scale, expected / scale, atol=0.12)


def test_posteriors_are_integrals_over_the_likelihood(loud):
    """One amplitude with the scale marginalised, and the evidence: against adaptive quadrature of ln L itself."""
    likelihood = Likelihood(loud, [Spectrum.even()], (2, 3, 4), (1,))
    best = likelihood.find_maximum()
    (found,), evidence = compute_posteriors_and_evidence(likelihood, best)
    unit = likelihood.unit[0] * best.noise_scale**2
    top = likelihood(best.amplitudes, best.noise_scale)

    def over_scale(amplitude):
        return quad(
            lambda t: np.exp(likelihood((amplitude,), np.exp(t / 2)) - top),
            *np.log(best.noise_scale**2 * np.array([0.8, 1.25])),
        )[0]

    for amplitude in best.amplitudes[0] * np.array([0.7, 1.0, 1.4]):
        ratio = over_scale(amplitude) / over_scale(best.amplitudes[0])
        expected = found.likelihood(amplitude) / found.likelihood(best.amplitudes[0])
        assert expected == pytest.approx(ratio, rel=2e-3)
    span = found.root[[0, -1]] ** 2
    whole = quad(lambda a: over_scale(a) * unit / (unit + a) ** 2, *span, epsrel=1e-6)[0]
    nothing = Likelihood(loud, [Spectrum.even()], (2, 3, 4), (1,))
    zero = nothing.profile_log_likelihood(np.zeros(1)) + nothing.chi2 / 2
    tau = nothing.chi2 / nothing.n_data
    nothing = quad(lambda t: np.exp(likelihood((0.0,), np.exp(t / 2)) - zero), *np.log(tau * np.array([0.8, 1.25])))[0]
    assert evidence == pytest.approx(np.log(whole) + top - np.log(nothing) - zero, abs=2e-3)


@pytest.mark.slow
def test_two_amplitudes_are_marginalised(loud):
    """The other amplitude integrated by brute force, the scale of the errors fixed."""
    likelihood = Likelihood(loud, [Spectrum.odd(), Spectrum.even()], (2, 3, 4), (1,), noise_scale=False)
    best = likelihood.find_maximum()
    found, evidence = compute_posteriors_and_evidence(likelihood, best)
    u = likelihood.unit
    other = np.geomspace(1e-3, 1e5, 600)
    weight = np.gradient(other) * u[0] / (u[0] + other) ** 2

    def marginal(even):
        return np.sum(weight * np.exp([likelihood((odd, even)) - best.log_likelihood for odd in other]))

    reference = marginal(best.amplitudes[1])
    for even in best.amplitudes[1] * np.array([0.5, 1.8]):
        expected = found[1].likelihood(even) / found[1].likelihood(best.amplitudes[1])
        assert expected == pytest.approx(marginal(even) / reference, rel=5e-3)
    grid = np.geomspace(1, 1e4, 60)
    whole = np.sum(np.gradient(grid) * u[1] / (u[1] + grid) ** 2 * [marginal(even) for even in grid])
    assert evidence == pytest.approx(np.log(whole) + best.log_likelihood, abs=0.02)


def test_solution_in_place_of_normal_equations():
    normal = fit.normal_equations(FIELD, 3)
    one = fit_background(normal, [Spectrum.flat()])
    two = fit_background(fit.solve(normal), [Spectrum.flat()])
    np.testing.assert_allclose(two.amplitudes, one.amplitudes, rtol=1e-6, atol=1e-9)
    assert two.log_evidence == pytest.approx(one.log_evidence, abs=1e-8)
    robust = fit_background(fit.robust.student_t(FIELD, 3), [Spectrum.flat()])
    assert (robust.noise_scale, robust.noise_scale_error) == (1.0, 0.0)
    prior = fit.gaussian_prior(3, 5.0)
    np.testing.assert_allclose(fit_background(normal + prior, [Spectrum.flat()]).amplitudes, one.amplitudes, rtol=1e-9)
    with pytest.raises(ParameterError, match="holds a prior"):
        fit_background(fit.solve(normal, prior), [Spectrum.flat()])


def test_degrees_that_are_free_are_not_shrunk():
    """Power in degree 2 does not count where degree 2 is free."""
    signal = sim.systematics(Spectrum.given([0.0, 5e5]), 1, lmax=2)
    normal = fit.normal_equations(sim.observe(sim.quasars(2000, 1), signal, 2, sigma=60.0), 4)
    assert fit_background(normal, Spectrum.flat()).log_likelihood > 100
    free = fit_background(normal, Spectrum.flat(), free=(1, 2))
    assert free.degrees == (3, 4)
    assert free.log_likelihood < 5


def test_messages():
    normal = fit.normal_equations(FIELD, 3)
    with pytest.raises(ModesError, match="degree 5 is not fitted: these normal equations go from degree 1 to 3"):
        fit_background(normal, Spectrum.flat(), degrees=(2, 5))
    with pytest.raises(ParameterError, match="a list of fit.background.Spectrum, one at least"):
        fit_background(normal, [])
    with pytest.raises(ParameterError, match="has no power in degrees 2, 3"):
        fit_background(normal, Spectrum.given([1.0, 0, 0]))
    with pytest.raises(ParameterError, match="the power of T2 is -1 .* no field has a negative power"):
        fit_background(
            normal, Spectrum("bad", lambda lmax: np.where(np.arange(lmax) == 1, -1.0, 1.0) * np.ones((2, lmax)))
        )
    with pytest.raises(ParameterError, match="fitted to normal equations or to a Solution, not to a Field"):
        fit_background(FIELD, Spectrum.flat())
    with pytest.raises(ModesError, match="whole numbers from 1 on"):
        fit_background(normal, Spectrum.flat(), degrees="2, 3")
    still = fit.normal_equations(FIELD.minus(FIELD.motion), 3)
    with pytest.raises(DegeneracyError, match="residuals are zero: they do not tell the scale"):
        fit_background(still, Spectrum.flat())
    assert (fit_background(still, Spectrum.flat(), noise_scale=False).amplitudes == 0).all()
    assert "the residuals are zero" in fit.solve(still).report()
    two = Field(FIELD.lon[:2], FIELD.lat[:2], FIELD.motion[:, :2], FIELD.sigma[:, :2])
    with pytest.raises(DegeneracyError, match="2 sources do not determine the 6 coefficients"):
        fit_background(fit.normal_equations(two, 3), Spectrum.flat())
    few = fit.resample.bootstrap(FIELD, 3, 10, 1, progress=False).resampled_solution
    with pytest.raises(DegeneracyError, match="replicates determine no covariance"):
        fit_background(replace(few, formal_covariance=None), Spectrum.flat())
