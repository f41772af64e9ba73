"""Robust likelihoods and excess noise."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many, real_catalogue

import fit
import sim
from fit.robust import _reweight, student_t
from fit.robust._reweight import ERRORS_TOO_SMALL, SourceWeights, StudentT
from vsh import Field, Modes
from vsh.io.catalogue import read_field
from vsh.tools.notes import codes_of

TRUTH = np.array([1.0, 2, 3, 0, 4, 0])
SKY = sim.Population(*sim.plane_avoiding_sky(1500, rng=1), None)


def spoilt(seed, share=0.05, factor=20.0, names=None):
    """Motions whose errors are understated by `factor` for a share of the sources."""
    rng = np.random.default_rng(seed)
    sigma = rng.uniform(20, 60, (2, len(SKY)))
    rho = rng.uniform(-0.7, 0.7, len(SKY))
    true = sigma * np.where(rng.uniform(size=len(SKY)) < share, factor, 1.0)
    field = sim.observe(SKY, sim.spin(TRUTH[:3]) + sim.acceleration(TRUTH[3:]), rng, sigma=true, rho=rho)
    return Field(field.lon, field.lat, field.motion, sigma, rho, name=names)


def pull(solution):
    found = np.r_[solution.spin.value, solution.acceleration.value]
    return (found - TRUTH) / np.r_[solution.spin.sigma, solution.acceleration.sigma]


@pytest.mark.slow
@few_or_many(40, 200)
def test_pulls_stay_standard_normal_with_bad_errors(n_skies):
    pulls = np.array([pull(student_t(spoilt(seed), Modes(1)).solution) for seed in range(n_skies)])
    assert abs(pulls.std() - 1) < 0.15
    assert np.abs(pulls.mean(0)).max() < 4 / np.sqrt(n_skies)
    plain = np.array([pull(fit.fit_field(spoilt(seed), 1)) for seed in range(n_skies)])
    assert plain.std() > 2


@pytest.mark.slow
def test_good_errors_cost_little():
    pulls = np.array([pull(student_t(spoilt(seed, share=0), Modes(1)).solution) for seed in range(100)])
    assert abs(pulls.std() - 1) < 0.15
    # A bivariate Gaussian seen by a likelihood of heavier tails: a tenth at most.
    assert 0.9 < student_t(spoilt(1, share=0), Modes(1)).inflation < 1.1


@pytest.mark.parametrize("n", [6000, 2500])
@pytest.mark.parametrize("case", ["Gaussian", "tails", "half of the sky", "a cap"])
def test_steps_settle_where_rounds_do(case, n, monkeypatch):
    """Many sources go by Newton's steps, from the plain fit or from that of a sample: to the values of the rounds."""
    rng = np.random.default_rng(3)
    lon, lat = sim.uniform_sky(n, rng)
    sigma, rho, noise = 10 ** rng.uniform(1, 2, (2, n)), rng.uniform(-0.5, 0.5, n), rng.normal(size=(2, n))
    if case in ("tails", "a cap"):
        noise *= np.sqrt(3 / rng.chisquare(3, n))
    noise[:, (lon < np.pi) & (case == "half of the sky")] *= 3
    field = Field(lon, lat, sigma * np.stack([noise[0], rho * noise[0] + np.sqrt(1 - rho**2) * noise[1]]), sigma, rho)
    field = field[np.abs(lat) > 0.3] if case == "a cap" else field
    rounds = student_t(field, 2, tolerance=1e-6)
    monkeypatch.setattr(_reweight, "_SAMPLE", 1000)
    monkeypatch.setattr(_reweight, "_MANY", 4000)
    if n <= 4000:  # there is no sample, which alone goes by rounds
        monkeypatch.setattr(_reweight, "_fit_by_rounds", None)
    steps = student_t(field, 2)
    assert steps.n_rounds < _reweight._MOST_STEPS
    np.testing.assert_allclose(steps.solution.values, rounds.solution.values, atol=3e-4 * rounds.solution.sigma.min())
    np.testing.assert_allclose(steps.solution.covariance, rounds.solution.covariance, rtol=1e-5,
                               atol=1e-5 * rounds.solution.sigma.min() ** 2)  # fmt: skip
    assert steps.nu == pytest.approx(rounds.nu, rel=1e-3)
    assert steps.log_likelihood == pytest.approx(rounds.log_likelihood, abs=1e-3)


@pytest.mark.parametrize("components", [1, 2])
def test_step_of_nu_is_newtons(components):
    """From the likelihood of X² and no more: its slope vanishes where the steps end."""
    x2 = np.random.default_rng(1).chisquare(components, 4000) * 3 / np.random.default_rng(2).chisquare(3, 4000)
    weight = StudentT(6.0, True, components)
    for _ in range(8):
        beyond = x2 / (weight.nu + x2)
        sums = {"log": np.log1p(x2 / weight.nu).sum(), "beyond": beyond.sum()}
        weight, length = weight.take_newton_step(sums | {"slope of beyond": (beyond / (weight.nu + x2)).sum()}, len(x2))
    nus = weight.nu * np.array([0.99, 1.0, 1.01])
    values = [_reweight._compute_mean_log_density(nu, components, np.log1p(x2 / nu).mean()) for nu in nus]
    assert values[1] > max(values[0], values[2])
    assert length < 1e-6
    assert StudentT(6.0, False).take_newton_step({}, 1) == (StudentT(6.0, False), 0.0)


def test_worst_sources_are_named():
    names = np.array([f"Q{i}" for i in range(len(SKY))])
    field = spoilt(1, share=0, names=names)
    motion = field.motion.copy()
    motion[0, 77] += 5000
    found = student_t(Field(field.lon, field.lat, motion, field.sigma, field.rho, name=names), Modes(1))
    assert found.weights.argmin() == 77
    assert "sources with the lowest weights: Q77 (" in found.solution.notes[-1]
    assert 0.5 * len(SKY) < found.effective < len(SKY)
    assert found.solution.errors_from == "the residuals of the robust fit, source by source"


def test_weights_are_those_of_the_likelihood():
    """u = −2 d ln L / d X², by numerical derivative of the density of Student's t with two components."""
    x2, step = np.array([0.1, 1.0, 5.0, 50.0]), 1e-4

    def minus_two_log(x2):
        return (3.0 + 2) * np.log1p(x2 / 3.0)

    u, slope = StudentT(3.0, False)(x2)
    np.testing.assert_allclose(u, (minus_two_log(x2 + step) - minus_two_log(x2 - step)) / (2 * step), rtol=1e-6)
    numeric = (StudentT(3.0, False)(x2 + step)[0] - StudentT(3.0, False)(x2 - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope, numeric, rtol=1e-5)


def test_nu_is_found():
    rng = np.random.default_rng(1)
    n = 20_000
    population = sim.Population(*sim.uniform_sky(n, rng), None)
    field = sim.observe(population, sim.spin((0, 0, 0)), rng, sigma=10.0)
    heavy = Field(field.lon, field.lat, field.motion / np.sqrt(rng.chisquare(3, n) / 3), field.sigma)
    found = fit.robust.student_t(heavy, Modes(1))
    # Fisher's information of ν = 3 from 20 000 pairs: a few per cent.
    assert found.nu == pytest.approx(3, rel=0.1)
    assert fit.robust.student_t(heavy, Modes(1), nu=5).nu == 5
    with pytest.raises(ValueError, match="nu must be above zero"):
        fit.robust.student_t(heavy, Modes(1), nu=0)


def noisy(seed, extra, factor=1.0):
    rng = np.random.default_rng(seed)
    n = 4000
    population = sim.Population(*sim.uniform_sky(n, rng), None)
    sigma, rho = 10 ** rng.uniform(0.5, 2, (2, n)), rng.uniform(-0.8, 0.8, n)
    field = sim.observe(
        population, sim.spin(TRUTH[:3]) + sim.acceleration(TRUTH[3:]), rng, sigma=factor * sigma, rho=rho
    )
    motion = field.motion + extra * rng.standard_normal((2, n))
    return Field(field.lon, field.lat, motion, sigma, rho)


@pytest.mark.slow
def test_excess_noise_is_recovered():
    found = [fit.robust.excess_noise(noisy(seed, 15.0), Modes(1)) for seed in range(60)]
    pulls = np.array([(f.excess_noise - 15) / f.excess_noise_error for f in found])
    assert abs(pulls.mean()) < 4 / np.sqrt(60)
    assert abs(pulls.std() - 1) < 4 / np.sqrt(120)
    of_the_fit = np.array([pull(f.solution) for f in found])
    assert abs(of_the_fit.std() - 1) < 4 / np.sqrt(2 * of_the_fit.size)


def test_components_that_are_exchanged_change_no_excess_noise():
    """East is as good as north: the field turned by 90°, of the same sources, has the same likelihood."""
    field = noisy(1, 15.0)
    turned = Field(field.lon, field.lat, field.motion[::-1] * [[1], [-1]], field.sigma[::-1], -field.rho)
    for scale in (False, True):
        found, other = (fit.robust.excess_noise(each, Modes(1), scale=scale) for each in (field, turned))
        assert other.excess_noise == pytest.approx(found.excess_noise, rel=0.02)
        assert other.excess_noise_error == pytest.approx(found.excess_noise_error, rel=0.02)


def test_chi2_is_that_of_the_catalogue_beside_a_noise_too():
    field = noisy(1, 200.0)
    found = student_t(field, 1, noise=200.0).solution
    assert found.chi2 == pytest.approx(np.sum(found.residuals(field).whitened ** 2))
    assert found.reduced_chi2 > 10


def test_excess_noise_and_scale_together():
    found = [fit.robust.excess_noise(noisy(seed, 15.0, 1.3), Modes(1), scale=True) for seed in range(40)]
    for value, name in ((15.0, "excess_noise"), (1.3, "scale")):
        pulls = np.array([(getattr(f, name) - value) / getattr(f, f"{name}_error") for f in found])
        assert abs(pulls.mean()) < 4 / np.sqrt(40)
        assert abs(pulls.std() - 1) < 4 / np.sqrt(80)


def test_no_excess_noise_is_none():
    found = [fit.robust.excess_noise(noisy(seed, 0.0), Modes(1)) for seed in range(20)]
    assert sum(f.excess_noise == 0 for f in found) >= 4  # half of the time the best variance would be negative
    assert all(f.excess_noise < 4 * f.excess_noise_error for f in found)


def test_vlba_accelerations_point_to_the_galactic_centre():
    field = read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    a = student_t(field, Modes(1)).solution.acceleration.to_frame("galactic")
    assert np.degrees(np.arccos(a.value[0] / a.amplitude)) < 10
    assert abs(a.amplitude - 1.69) < np.hypot(0.27, a.amplitude_error)


@pytest.mark.parametrize("weight", [StudentT(3.0, False), StudentT(20.0, False)])
def test_shares_and_weights_agree_with_each_other(weight):
    """u is that of X²/(1 − share), and the share that of u: together, whatever the size of the share."""
    rng = np.random.default_rng(2)
    n = 40
    field = Field(rng.uniform(0, 6, n), rng.uniform(-1, 1, n), rng.normal(size=(2, n)) * 2, rng.uniform(0.5, 2, (2, n)))
    solution = fit.fit_field(field, 1)
    share = SourceWeights(solution, weight, 3.0 / field.information.sum() * 3)
    x2, u, slope, residual = share(field)
    chi2 = field.inner(residual, residual)
    own = 1 - chi2 / x2
    np.testing.assert_allclose(own, np.minimum(share.leverage * field.information * u, 0.9), atol=1e-9)
    assert own.max() > 0.2
    np.testing.assert_allclose(weight(chi2 / (1 - own)), [u, slope], rtol=1e-9)


def test_degrees_of_freedom_that_swing_settle(monkeypatch):
    """ν alternated with growing steps and never settled (126 coefficients from 2500 sources, residuals nearly Gaussian)."""
    target, nu = np.log(95.0), []

    def likeliest(mean_logs, components):  # answers each step by one that is 1.05 times as large, the other way
        return float(np.exp(target - 1.05 * (np.log(nu[-1]) - target)))

    monkeypatch.setattr(_reweight, "_find_likeliest_nu", likeliest)
    weight = StudentT(60.0, estimated=True)
    for _ in range(20):
        nu.append(weight.nu)
        weight = weight.fit_nu(_OnePart(), None, "")
    assert np.log(weight.nu) == pytest.approx(target, abs=0.01)


class _OnePart:
    def sum(self, work, **options):
        return 1, np.zeros(1)


@few_or_many(12, 100)
def test_equations_of_a_class_cover(n_skies):
    """Weights of the whole, errors from the residuals of the class: pulls are N(0, 1) where errors are wrong."""
    pulls = []
    for seed in range(n_skies):
        field = spoilt(seed, factor=3.0)
        fitted = fit.robust.student_t(field, 3)
        pulls += [pull(fit.solve(fitted.equations(part, 1))) for part in (field[:700], field[700:])]
        whole = fit.solve(fitted.equations(field, 3))
        np.testing.assert_allclose(whole.values, fitted.solution.values, atol=0.01 * whole.sigma.max())
        assert np.mean(whole.sigma / fitted.solution.sigma) == pytest.approx(1, abs=0.05)
    assert np.std(pulls) == pytest.approx(1, abs=3 / np.sqrt(12 * n_skies * 2))


def test_classes_of_excess_noise_have_it():
    field = spoilt(1, share=1.0, factor=2.0)
    fitted = fit.robust.excess_noise(field, 1)
    part = field[:500]
    wide = field.sigma[:, :500] ** 2 + fitted.excess_noise**2
    own = fitted.equations(part, 1)
    assert own.n_sources == 500
    assert np.trace(own.matrix) < np.trace(fit.normal_equations(part, 1).matrix)
    rho = part.rho * np.prod(part.sigma, 0) / np.sqrt(np.prod(wide, 0))
    expected = fit.normal_equations(Field(part.lon, part.lat, part.motion, np.sqrt(wide), rho), 1)
    np.testing.assert_allclose(own.matrix, expected.matrix, rtol=1e-12)


@pytest.mark.parametrize(("least", "noted"), [(0.0, True), (0.05, True), (0.3, False), (1.0, False)])
def test_errors_that_say_nothing_of_the_scatter_are_told(least, noted):
    """The same scatter for all sources: where many errors are far too small, so are those of the fit."""
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(0, 2 * np.pi, 3000), np.arcsin(rng.uniform(-1, 1, 3000))
    sigma = 1000 * rng.uniform(least, 1, (2, 3000))
    field = Field(lon, lat, 1000 * rng.normal(size=(2, 3000)), sigma)
    robust = fit.robust.student_t(field, 1)
    assert (ERRORS_TOO_SMALL in codes_of(robust.solution.notes)) == noted
    recommended = fit.recommended(field, 1)
    assert ("an excess noise of" in recommended.solution.report()) == noted
    assert (recommended.weights.noise > 0) == noted


def _too_small(rng, kind, n):
    """Scatters and quoted errors of sources: errors that say little of the scatter, and heavy tails that are real."""
    if kind == "uniform":
        return np.ones(n), rng.uniform(0, 1, n)
    if kind == "outliers":
        return np.where(rng.uniform(size=n) < 0.05, 20, 1), rng.uniform(0, 1, n)
    if kind == "a half":
        return np.ones(n), np.where(rng.uniform(size=n) < 0.5, 1, 0.02)
    return 1 / np.abs(rng.normal(size=n)), np.ones(n)  # Cauchy, with errors that are right


@pytest.mark.parametrize(
    "kind", ["uniform", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("outliers", "a half", "Cauchy"))]
)
def test_recommended_covers_zero_where_errors_are_far_too_small(kind):
    pulls, noises, losses = [], [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        lon, lat = rng.uniform(0, 2 * np.pi, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
        scatter, sigma = _too_small(rng, kind, 2000)
        field = Field(lon, lat, scatter * rng.normal(size=(2, 2000)), sigma * np.ones((2, 1)))
        fitted = fit.recommended(field, 2)  # below the degree from which a floor covers more
        pulls += [*(fitted.solution.values / fitted.solution.sigma)]
        noises.append(fitted.weights.noise)
        losses.append(np.mean(fitted.solution.sigma) / np.mean(fit.robust.student_t(field, 2).solution.sigma))
    assert np.sqrt(np.mean(np.square(pulls))) < 1.2  # 96 pulls: 1 ± .07; those of Student's t alone are 1.5 and more
    if kind == "Cauchy":  # nothing is gained by a noise there, and little is lost
        assert np.mean(losses) < 1.1
    else:
        assert all(0.3 < noise < 2 for noise in noises)


def test_noise_of_student_t_is_added_in_quadrature():
    field = spoilt(2, share=0.1, factor=5.0)
    wide = np.hypot(field.sigma, 30.0)
    rho = field.rho * np.prod(field.sigma, 0) / np.prod(wide, 0)
    one = fit.robust.student_t(field, 1, noise=30.0)
    two = fit.robust.student_t(Field(field.lon, field.lat, field.motion, wide, rho), 1)
    np.testing.assert_allclose(one.solution.values, two.solution.values, rtol=1e-9)
    np.testing.assert_allclose(one.log_likelihood, two.log_likelihood, rtol=1e-12)
    np.testing.assert_allclose(
        one.equations(field, 1).matrix, two.equations(field.with_errors(wide, rho), 1).matrix, rtol=1e-9
    )


@pytest.mark.parametrize("size", [1e5, 5e5])
@pytest.mark.parametrize("number", [5, 100])
def test_few_motions_of_a_thousand_errors_throw_nothing_off(number, size):
    """Newton's steps from a plain fit that they had thrown off went to 1e23 µas/yr, and were said to have converged."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        field = sim.observe(sim.quasars(5000, rng, "igql"), sim.spin((5.0, -8.0, 10.0)), rng, sigma=100.0)
        motion = field.motion.copy()
        motion[:, :number] += rng.normal(size=(2, number)) * size
        fitted = student_t(replace(field, motion=motion), 1)
        clean = student_t(field[number:], 1).solution
        assert np.abs((fitted.solution.values - clean.values) / clean.sigma).max() < 1 + 0.01 * number
        assert (fitted.solution.sigma < 1.6 * clean.sigma).all()
