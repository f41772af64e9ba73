"""The chain from a field to its solution: what it must equal, and laws it must obey."""

import numpy as np
import pytest
from conftest import random_field
from hypothesis import given, settings
from hypothesis import strategies as st

import fit
import sim
from vsh import Coefficients, Field, Modes
from vsh.basis import harmonics
from vsh.tools.errors import DegeneracyError, FieldError, FrameError, ModesError, VshError


def test_recovers_a_noiseless_truth():
    rng = np.random.default_rng(1)
    truth = Coefficients(Modes(6), rng.normal(size=len(Modes(6))))
    lon, lat = sim.uniform_sky(2000, rng)
    found = fit.fit_field(Field(lon, lat, truth.at(lon, lat), np.ones((2, 2000))), 6)
    np.testing.assert_allclose(found.coefficients.values, truth.values, atol=1e-12)
    assert found.chi2 == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("lmax", [1, 3])
def test_normal_equations_are_their_definition(lmax):
    """Σ Aᵀ C⁻¹ A, Σ Aᵀ C⁻¹ y and Σ yᵀ C⁻¹ y, source by source with the inverse they avoid."""
    field, modes = random_field(60, seed=4), Modes(lmax)
    found = fit.normal_equations(field, modes)
    basis = harmonics(field.lon, field.lat, modes)
    matrix, rhs, chi2 = 0, 0, 0
    for k in range(len(field)):
        (s1, s2), rho, a, y = field.sigma[:, k], field.rho[k], basis[:, :, k], field.motion[:, k]
        inverse = np.linalg.inv([[s1 * s1, rho * s1 * s2], [rho * s1 * s2, s2 * s2]])
        matrix, rhs, chi2 = matrix + a @ inverse @ a.T, rhs + a @ inverse @ y, chi2 + y @ inverse @ y
    np.testing.assert_allclose(found.matrix, matrix, atol=1e-10)
    np.testing.assert_allclose(found.rhs, rhs, atol=1e-10)
    assert found.chi2_null == pytest.approx(chi2)
    assert found.n_data == 120


def test_weights_are_the_inverse_covariance():
    field = random_field(10, seed=1)
    for k in range(10):
        (s1, s2), rho = field.sigma[:, k], field.rho[k]
        a, b, c = field.weights[:, k]
        product = np.array([[a, c], [c, b]]) @ [[s1 * s1, rho * s1 * s2], [rho * s1 * s2, s2 * s2]]
        np.testing.assert_allclose(product, np.eye(2), atol=1e-9)


@given(seed=st.integers(0, 1000), cut=st.integers(1, 199), lmax=st.integers(1, 4))
@settings(max_examples=30)
def test_whole_is_the_sum_of_its_parts(seed, cut, lmax):
    field = random_field(200, seed)
    whole = fit.normal_equations(field, Modes(lmax))
    total = sum([fit.normal_equations(part, Modes(lmax)) for part in (field[:cut], field[cut:])])
    np.testing.assert_allclose(total.matrix, whole.matrix, atol=1e-12 * np.abs(whole.matrix).max())
    np.testing.assert_allclose(total.rhs, whole.rhs, atol=1e-12 * np.abs(whole.rhs).max())
    rest = whole - fit.normal_equations(field[:cut], Modes(lmax))
    np.testing.assert_allclose(
        rest.matrix, fit.normal_equations(field[cut:], Modes(lmax)).matrix, atol=1e-11 * np.abs(whole.matrix).max()
    )
    assert (total.n_data, rest.n_data) == (400, 400 - 2 * cut)


def pulls(fits, correlated):
    """Of `fits` skies with correlated errors, fitted with the correlation or without.

    The correlation has the sign of east times north in a spin about x, so that it does not
    average out over the sky.
    """
    population = sim.Population(*sim.plane_avoiding_sky(300, rng=2), None)
    rho = -0.9 * np.sign(np.sin(population.lat) * np.sin(2 * population.lon))
    truth = Coefficients.from_vectors(glide=(3, 1, 2), rotation=(1, 0, -1), lmax=2)
    out = []
    for seed in range(fits):
        field = sim.observe(population, truth, rng=seed, sigma=[[10.0], [15.0]], rho=rho)
        if not correlated:
            field = Field(field.lon, field.lat, field.motion, field.sigma)
        found = fit.fit_field(field, 2)
        out.append((found.coefficients.values - truth.values) / found.sigma)
    return np.array(out)


def test_pulls_of_500_fits_are_standard_normal():
    found = pulls(500, correlated=True)
    assert np.abs(found.mean(0)).max() < 4 / np.sqrt(500)
    # The variance of all pulls: the 16 of a sky are correlated, so count skies, not pulls.
    mean_square = (found**2).mean(1)
    assert abs(mean_square.mean() - 1) < 4 * mean_square.std() / np.sqrt(500)
    assert np.abs(found.std(0) - 1).max() < 4 / np.sqrt(2 * 500)


@pytest.mark.slow
def test_pulls_show_a_correlation_that_was_ignored():
    found = pulls(500, correlated=False)
    assert np.abs(found.std(0) - 1).max() > 6 / np.sqrt(2 * 500)


def test_chi2_is_that_of_the_residuals():
    field = random_field(500, seed=3)
    found = fit.fit_field(field, 3)
    assert found.residuals(field).chi2.sum() == pytest.approx(found.chi2, rel=1e-10)
    assert found.dof == 1000 - 30
    assert found.reduced_chi2 == found.chi2 / found.dof


def test_too_few_sources_say_what_to_do():
    field = random_field(10, seed=3)
    with pytest.raises(DegeneracyError, match="10 sources cannot separate 70 modes.*lower lmax from 5"):
        fit.fit_field(field, 5)
    normal, prior = fit.normal_equations(field, Modes(5)), fit.gaussian_prior(Modes(5), sigma=1.0)
    assert np.isfinite(fit.solve(normal, prior=prior).sigma).all()


def test_blind_spot_is_named():
    """Sources within arc seconds of the pole cannot tell a spin about x from a glide along y."""
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 6, 200), np.pi / 2 - rng.uniform(0, 1e-5, 200)
    field = Field(lon, lat, np.zeros((2, 200)), np.ones((2, 200)))
    with pytest.raises(DegeneracyError, match=r"worst in .*t\(1,1.*s\(1,1|worst in .*s\(1,1.*t\(1,1"):
        fit.fit_field(field, 1)


def test_different_degrees_and_frames_do_not_add():
    field = random_field(50, seed=1)
    one = fit.normal_equations(field, Modes(1))
    with pytest.raises(ModesError, match="degree 1 and 2"):
        one + fit.normal_equations(field, Modes(2))
    with pytest.raises(FrameError, match="icrs and galactic"):
        one + fit.normal_equations(field.to_frame("galactic"), Modes(1))
    with pytest.raises(FrameError, match="the fit is in icrs, the field in galactic"):
        fit.solve(one).residuals(field.to_frame("galactic"))


def test_prior_counts_no_data():
    """χ² and its degrees of freedom are those of the sources: with a prior that says nothing, and with one that says all."""
    field, modes = random_field(500, seed=1), Modes(3)
    normal = fit.normal_equations(field, modes)
    plain = fit.solve(normal)
    for sigma in (1e6, 1.0, 1e-6):
        found = fit.solve(normal, fit.gaussian_prior(modes, sigma))
        assert found.n_data == 1000
        assert found.chi2 == pytest.approx(found.residuals(field).chi2.sum(), rel=1e-9)
    assert found.by_prior == pytest.approx(30, abs=1e-6)
    assert (found.dof, found.chi2) == (1000, pytest.approx(normal.chi2_null))
    weak = fit.solve(normal, fit.gaussian_prior(modes, 1e6))
    assert (weak.dof, weak.chi2) == (970, pytest.approx(plain.chi2))
    assert weak.by_prior == pytest.approx(0, abs=1e-6)
    prior = fit.gaussian_prior(modes, 1.0)
    again = fit.solve(normal + prior - prior)
    np.testing.assert_allclose(again.values, plain.values, rtol=1e-9)
    assert (again.dof, again.chi2) == (970, pytest.approx(plain.chi2))
    np.testing.assert_allclose(
        fit.solve(normal - prior + prior + prior).values, fit.solve(normal, prior).values, rtol=1e-9
    )


def test_prior_alone_comes_back():
    modes = Modes(2)
    prior = fit.gaussian_prior(modes, sigma=np.arange(1.0, 17.0), mean=3.0)
    found = fit.solve(prior)
    np.testing.assert_allclose(found.coefficients.values, 3.0)
    np.testing.assert_allclose(found.sigma, np.arange(1.0, 17.0))
    assert found.chi2 == pytest.approx(0, abs=1e-12)
    nothing = fit.gaussian_prior(modes, sigma=np.inf)
    field = random_field(100, seed=1)
    with_it, without = fit.normal_equations(field, modes) + nothing, fit.normal_equations(field, modes)
    np.testing.assert_array_equal(with_it.matrix, without.matrix)
    assert with_it.n_data == without.n_data
    with pytest.raises(ModesError, match="positive"):
        fit.gaussian_prior(modes, sigma=0)


def test_frame_of_the_fit_does_not_matter_to_the_vectors():
    field = random_field(500, seed=8)
    icrs, galactic = fit.fit_field(field, 1), fit.fit_field(field.to_frame("galactic"), 1)
    for name in ("spin", "acceleration"):
        one, two = getattr(icrs, name), getattr(galactic, name).to_frame("icrs")
        np.testing.assert_allclose(one.value, two.value, atol=1e-9)
        np.testing.assert_allclose(one.covariance, two.covariance, atol=1e-9)
    assert icrs.chi2 == pytest.approx(galactic.chi2)


def test_notes_travel_from_the_field_to_the_report():
    field = random_field(100, seed=1).add_note("measured at noon")
    solution = fit.solve(fit.normal_equations(field, Modes(1)) + fit.normal_equations(field, Modes(1)))
    assert solution.notes == ("measured at noon",)
    assert "measured at noon" in solution.report()


def test_wrong_nouns_are_told_the_right_ones():
    field = random_field(100, seed=1)
    with pytest.raises(FieldError, match="is a path: read it first"):
        fit.normal_equations("catalogue.fits", 1)
    with pytest.raises(VshError, match="solve takes normal equations, not a Field"):
        fit.solve(field)
    with pytest.raises(ModesError, match="GiB: lower lmax"):
        fit.normal_equations(field, 200)
    assert fit.normal_equations(field, 2).modes == Modes(2)
    words = "".join(map(repr, (field, fit.normal_equations(field, 1), fit.fit_field(field, 1))))
    assert len(words) < 300


@pytest.mark.parametrize("of_scatter", [
    lambda field: fit.resample.bootstrap(field, 3, 50, rng=1).resampled_solution,
    lambda field: fit.resample.jackknife(field, 3, 4).resampled_solution,
    lambda field: fit.robust.excess_noise(field, 3),
])  # fmt: skip
def test_motions_all_alike_have_no_errors_of_their_own(of_scatter):
    """Errors of zero went on into the floor and the spectrum, and ended in the words of a matrix."""
    field = random_field(2000, seed=1)
    still = Field(field.lon, field.lat, np.zeros((2, 2000)), field.sigma)
    assert fit.fit_field(still, 3).chi2 == 0
    with pytest.raises(DegeneracyError, match="are zero: the motions have no scatter"):
        of_scatter(still)
