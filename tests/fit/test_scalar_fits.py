"""Fits of scalar fields: the same chain as for motions."""

import contextlib

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import chdtri

import fit
from fit.resample import block_bootstrap, bootstrap, jackknife
from fit.robust import compute_truncation_factors
from vsh import (
    ConvergenceError,
    FieldError,
    Modes,
    ModesError,
    ParameterError,
    ScalarCoefficients,
    ScalarField,
    ScalarModes,
)
from vsh.models.covariance import ScalarSpectrum
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad


def sky(n=2000, seed=1, lmax=2, tails=False, unit="µas"):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-0.7, 1, n))
    truth = ScalarCoefficients(lmax, np.random.default_rng(9).normal(0, 10, len(ScalarModes(lmax))))
    sigma = rng.uniform(5, 30, n)
    noise = rng.standard_t(3, n) if tails else rng.normal(size=n)
    return ScalarField(lon, lat, truth.at(lon, lat) + sigma * noise, sigma, unit), truth


def test_degree_zero_is_the_weighted_mean():
    field, _ = sky()
    weights = 1 / field.sigma**2
    mean, error = fit.fit_field(field, 0).mean
    assert mean == pytest.approx(np.average(field.values, weights=weights), rel=1e-13)
    assert error == pytest.approx(1 / np.sqrt(weights.sum()), rel=1e-13)


@pytest.mark.parametrize("lmax", [0, 1, 4, 9])
def test_three_ways_to_the_same_equations(lmax):
    field, _ = sky()
    one = fit.normal_equations(field, lmax, method="design-matrix")
    two = fit.normal_equations(field, ScalarModes(lmax), method="compressed")
    three = fit.Moments.of(field, lmax + 1).normal_equations(lmax)
    parts = fit.normal_equations([field[:700], field[700:]], lmax)
    for other in (two, three, parts):
        assert_allclose(other.matrix, one.matrix, atol=1e-12 * one.matrix.max())
        assert_allclose(other.rhs, one.rhs, atol=1e-12 * np.abs(one.rhs).max())
        assert other.chi2_null == pytest.approx(one.chi2_null, rel=1e-12)
        assert (other.n_sources, other.unit, other.modes) == (2000, "µas", ScalarModes(lmax))


def test_truth_and_errors():
    pulls, chi2 = [], []
    for seed in range(300):
        field, truth = sky(300, seed)
        found = fit.fit_field(field, 2)
        pulls.append((found.values - truth.values) / found.sigma)
        chi2.append(found.chi2 / found.dof)
        assert found.dof == 300 - 9
    assert np.std(pulls) == pytest.approx(1, abs=0.04)
    assert abs(np.mean(pulls)) < 0.06
    assert np.mean(chi2) == pytest.approx(1, abs=0.02)


@pytest.mark.slow
def test_without_a_signal_p_values_are_uniform():
    rng = np.random.default_rng(1)
    field, _ = sky(200)
    p = []
    for _ in range(400):
        noise = field.minus(field.values - field.sigma * rng.normal(size=200))
        p.append([row.p_value for row in fit.spectrum.spectrum(fit.fit_field(noise, 2))])
    for column in np.array(p).T:
        assert np.mean(column < 0.1) == pytest.approx(0.1, abs=0.05)


@pytest.mark.slow
def test_clip_leaves_out_as_many_as_of_motions_and_corrects_for_it():
    pulls, shares, chi2 = [], [], []
    for seed in range(200):
        field, truth = sky(500, seed)
        noise = field.minus(truth.at(field.lon, field.lat))
        found = fit.clip(noise, 1, threshold=1.5)
        pulls.append(found.solution.values / found.solution.sigma)
        chi2.append(found.solution.reduced_chi2)
        with contextlib.suppress(ConvergenceError):  # one source more or less, now and then
            shares.append(fit.clip(noise, 0, kappa=2.0).n_clipped / 500)
    assert len(shares) > 150
    assert np.mean(shares) == pytest.approx(2**-4, abs=0.006)
    assert np.std(pulls) == pytest.approx(1, abs=0.06)
    assert np.mean(chi2) == pytest.approx(1, abs=0.03)
    assert "κ = 3, 4.59 times the median" in fit.clip(noise, 0, kappa=3.0).solution.notes[-1]


def test_truncation_of_one_component():
    x = np.random.default_rng(1).normal(size=2_000_000)
    limit = float(chdtri(1, 0.1))
    kept = x**2 < limit
    variance, share = compute_truncation_factors(limit / 2, 1)
    assert share == pytest.approx(np.mean(x[kept] ** 2), abs=3e-3)
    assert variance == pytest.approx(1 / share)


@pytest.mark.slow
def test_robust_fits_and_resampling_bring_errors_of_the_scatter():
    """Errors of heavy tails: plain ones are too small, those of residuals and replicates are right."""
    pulls = {"plain": [], "student": [], "bootstrap": [], "one step": [], "jackknife": []}
    for seed in range(40):
        field, truth = sky(300, seed, lmax=1, tails=True)
        plain = fit.fit_field(field, 1)
        found = {
            "plain": plain, "student": fit.robust.student_t(field, 1).solution,
            "bootstrap": bootstrap(field, 1, 50, seed, progress=False).resampled_solution,
            "one step": bootstrap(field, 1, 50, seed, progress=False).resampled_solution,
            "jackknife": jackknife(field, 1, 2, progress=False).resampled_solution,
        }  # fmt: skip
        for name, solution in found.items():
            pulls[name].append((solution.values - truth.values) / solution.sigma)
    assert np.std(pulls["plain"]) > 1.4
    for name in ("student", "bootstrap", "one step", "jackknife"):
        assert np.std(pulls[name]) == pytest.approx(1, abs=0.14), name


def test_other_replicates():
    """Errors of 40 blocks of the sky scatter by 12 %, and four of them by half that."""
    field, _ = sky(600, lmax=1)
    blocks = block_bootstrap(field, 1, 2, 500, 1, progress=False)
    assert np.mean(blocks.sigma / fit.fit_field(field, 1).sigma) == pytest.approx(1, abs=0.4)
    assert blocks.resampled_solution.mean[1] > 0


def test_moments_add_and_are_written(tmp_path):
    field, _ = sky()
    both = fit.Moments.of(field[:500], 3) + fit.Moments.of(field[500:], 2)
    both.write(tmp_path / "moments.fits")
    assert fit.storage.read(tmp_path / "moments.fits") == both
    assert both.kind is ScalarModes
    assert both.n_sources == 2000
    assert "µas" in both.report()
    with pytest.raises(ModesError, match="cannot add moments of values in µas and mag"):
        _ = both + fit.Moments.of(sky(unit="mag")[0], 2)


@pytest.mark.slow
def test_report_page_table(tmp_path):
    field, _ = sky(unit="mag")
    solution = fit.fit_field(field, 2)
    text = solution.report(long=True)
    assert "Spherical harmonics of a scalar field, in mag" in text
    assert "mean  " in text
    assert "F0" in text
    assert "µas" not in text
    assert "spin" not in text
    assert "coefficients   9" in fit.fit_field(field, 2).report(long=True)
    assert "Mean & $-2.53 \\pm 0.3" in solution.latex()
    figures = fit.output.draw_figures(solution, field)
    assert set(figures) == {"sky", "spectrum", "correlation", "residuals"}
    fit.output.write_html(solution, field, tmp_path / "page.html", figures=figures)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "µas" not in page
    assert "mag" in page
    assert "mean  " in fit.fit_field(field, 0).report()


def systematic_sky(seed, power, n=600, quoted=1.0):
    """Parallaxes without a zero point but systematic errors of one power for each mode, from degree 0 to 8."""
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-0.7, 1, n))
    modes = ScalarModes(8)
    errors = ScalarCoefficients(modes, np.sqrt(power * ScalarSpectrum.flat().variances(modes)) * rng.normal(size=81))
    sigma = rng.uniform(50, 150, n)
    return ScalarField(lon, lat, errors.at(lon, lat) + sigma * rng.normal(size=n), quoted * sigma, "µas")


def pulls_of(power, skies=60, **options):
    """Mean and dipole in their errors, of the recommended fit to many skies, (skies, 4)."""
    solutions = [fit.recommended(systematic_sky(seed, power, **options)).solution for seed in range(skies)]
    return np.array([[s.mean[0] / s.mean[1], *(s.dipole.value / s.dipole.sigma)] for s in solutions])


@pytest.mark.parametrize(
    ("power", "options"),
    [(0.0, {}), (2000.0, {}), (0.0, {"n": 60}), pytest.param(2000.0, {"quoted": 0.3}, marks=pytest.mark.slow)],
)
def test_errors_with_the_floor_cover(power, options):
    """Systematic errors three times the noise of the mean, few sources, errors three times too small."""
    pulls = pulls_of(power, **options)
    assert 0.55 < np.sqrt(np.mean(pulls**2)) < 1.2  # the average over spectra is careful of a flat one
    assert np.mean(np.abs(pulls) < 1.96) > 0.9


def test_floor_is_the_power_that_was_put_in():
    field = systematic_sky(3, 2000.0, 20_000)
    found = fit.background.floor(fit.fit_field(field, 8), shapes="flat")
    shifted = fit.background.floor(fit.fit_field(field.minus(500.0), 8), shapes="flat")
    assert shifted.power == pytest.approx(found.power)  # the zero point is no systematic error of the others
    assert found.power_interval[0] < 2000 < found.power_interval[1]
    assert found.mean_error == pytest.approx(np.sqrt(found.power / (4 * np.pi)), rel=0.1)  # of its mean power
    assert found.dipole_error == pytest.approx(np.sqrt(3) * found.mean_error)
    solution = fit.recommended(systematic_sky(3, 2000.0)).solution
    added = solution.floor.added(solution.modes)
    assert_allclose(added[0], 4 * np.pi * solution.floor.mean_error**2)
    assert_allclose(added[1:4] * [1, 2, 2], 4 * np.pi / 3 * solution.floor.dipole_error**2)
    assert not added[4:].any()


def test_floor_is_read_as_it_was_written_and_drawn(tmp_path):
    result = fit.recommended(systematic_sky(1, 500.0)).solution
    result.write(tmp_path / "solution.ecsv")
    assert fit.storage.read(tmp_path / "solution.ecsv") == result
    assert result.floor.to_table().colnames == ["parameter", "power", "power_low", "power_high", "floor"]
    assert "spin" not in result.floor.report(long=True)
    assert len(result.plot().patches) + len(result.plot().collections) > 2
    result.floor.plot()


def test_answer_has_the_mean_first():
    result = fit.recommended(sky()[0])
    solution = result.solution
    assert (result.mean, result.dipole.unit) == (solution.mean, "µas")
    labels, words = zip(*solution.answer.lines, strict=True)
    assert labels == ("mean", "dipole", "errors")
    assert words[0].startswith(f"{solution.mean[0]:+.1f} ± {solution.mean[1]:.1f} µas, p = ")
    assert solution.summary()["parameter"].tolist() == ["mean", "dipole_x", "dipole_y", "dipole_z"]


def test_excess_noise_of_numbers():
    rng = np.random.default_rng(1)
    field, _ = sky(4000)
    noisy = field.minus(-rng.normal(0, 20, len(field)))
    found = fit.robust.excess_noise(noisy, 2)
    assert abs(found.excess_noise - 20) < 3 * found.excess_noise_error
    scaled = fit.robust.excess_noise(noisy.with_errors(noisy.sigma / 2), 2, scale=True)
    assert abs(scaled.scale - 2) < 3 * scaled.scale_error


def test_blocks_of_the_mean_alone():
    rows, best, _ = fit.resample.compare_blocks(sky(3000)[0], 0)
    assert best in rows  # which are larger than the structure of degree 2


@pytest.mark.parametrize("method", ["least-squares", "clip", "student", "excess-noise", "bootstrap", "jackknife"])
def test_estimators_agree_on_the_mean(method):
    field, truth = sky(3000)
    value, error = fit.estimate(field, 2, method).solution.mean
    assert abs(value - truth.mean) < 4 * error


def test_dipole_of_counts_behind_a_mask_and_a_selection():
    """A density of 1 + d·r that is seen more often near the poles and not at all near the equator."""
    truth, pulls = np.array([0.0, 0.05, 0.1]), []
    map_lat = centres(32)[1]
    for seed in range(40):
        rng = np.random.default_rng(seed)
        lon, lat = rng.uniform(0, 2 * np.pi, 60_000), np.arcsin(rng.uniform(-1, 1, 60_000))
        seen = np.where(np.abs(lat) < 0.4, 0.0, 0.6 + 0.4 * np.sin(lat) ** 2)
        keep = rng.uniform(size=60_000) < seen * (1 + truth @ triad(lon, lat)[2]) / 1.2
        selection = np.where(np.abs(map_lat) < 0.4, 0.0, 0.6 + 0.4 * np.sin(map_lat) ** 2)
        field = ScalarField.from_counts(lon[keep], lat[keep], 8, selection)
        result = fit.recommended(field)
        pulls.append((result.dipole.value / (1 + result.mean[0]) - truth) / result.dipole.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert np.abs(np.mean(pulls, 0)).max() < 3 / np.sqrt(40)


def test_units_do_not_mix():
    with pytest.raises(ModesError, match="µas and mag"):
        _ = fit.normal_equations(sky()[0], 1) + fit.normal_equations(sky(unit="mag")[0], 1)
    prior = fit.gaussian_prior(ScalarModes(1), 5.0)
    solution = fit.solve(fit.normal_equations(sky()[0], 1), prior)
    assert solution.unit == "µas"
    assert solution.by_prior > 0


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda f: fit.solve_frame(f), "not a ScalarField"),
        (lambda f: fit.cross_check(f), "holds numbers, not motions"),
        (lambda f: fit.background.wave_limit(fit.fit_field(f, 3)), "a scalar field has neither"),
        (lambda f: fit.correlation.predict_covariance(f, 2), "has no motions"),
        (lambda f: fit.correlation.leakage(f, 1, 3), "has no motions"),
        (lambda f: fit.redshift.binned(f, 2, 2), "not ScalarField"),
        (lambda f: fit.secular_parallax.observer_velocity(f, 70), "holds numbers, not motions"),
        (lambda f: fit.normal_equations(f, 2, covariance=np.eye(4000)), "not of ScalarField"),
        (lambda f: fit.fit_field(f, Modes(2)), "expanded in ScalarModes"),
        (lambda f: fit.pairs.correlation_function(f, [0, 1, 2]), "holds numbers, not motions"),
        (lambda f: fit.fit_field(f, 1).spin, "no spin and no acceleration"),
    ],
)  # fmt: skip
def test_who_takes_none_says_why(call, said):
    with pytest.raises((FieldError, ModesError, ParameterError), match=said):
        call(sky()[0])
