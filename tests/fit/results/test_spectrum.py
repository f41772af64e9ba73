"""Power and its significance."""

import numpy as np
import pytest
from conftest import few_or_many
from scipy import stats

import fit
import sim
from vsh import Coefficients, Modes

TRUTH = Coefficients.from_vectors(glide=(8, -3, 1), lmax=3)
SKY = sim.Population(*sim.plane_avoiding_sky(400, rng=5, latitude=30), None)


def skies(n, truth):
    for seed in range(n):
        yield fit.fit_field(sim.observe(SKY, truth, rng=seed, sigma=50.0, rho=0.3), 3)


@few_or_many(80, 400)
def test_p_values_of_noise_are_uniform(n_skies):
    """On a cut sky, where the coefficients are correlated."""
    null = Coefficients(Modes(3), np.zeros(30))
    p = np.array([[s.p_value(kind, l) for kind in "TS" for l in (1, 2, 3)] for s in skies(n_skies, null)])
    for column in p.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3


@few_or_many(80, 400)
def test_power_is_debiased_and_its_error_is_its_scatter(n_skies):
    found = list(skies(n_skies, TRUTH))
    for kind, l in (("S", 1), ("T", 2)):
        power = np.array([s.power(kind, l) for s in found])
        error = power.std() / np.sqrt(len(power))
        assert abs(power.mean() - TRUTH.power(kind, l)) < 4 * error
        raw = np.mean([s.power(kind, l, debiased=False) for s in found])
        assert raw - TRUTH.power(kind, l) > 4 * error
        assert np.allclose(raw, np.mean([s.coefficients.power(kind, l) for s in found]))
    # The mean square of the stated error is the variance: 400 skies know it to 5 % (and its own scatter).
    error = np.sqrt(np.mean([s.power_error("S", 1) ** 2 for s in found]))
    assert abs(error / np.std([s.power("S", 1) for s in found]) - 1) < 4 / np.sqrt(n_skies)


def test_deviates_of_a_strong_signal_do_not_overflow():
    solution = next(skies(1, TRUTH * 1000))
    rows = fit.spectrum.spectrum(solution)
    assert [(row.kind, row.l) for row in rows] == [(kind, l) for kind in "TS" for l in (1, 2, 3)]
    assert rows[3].p_value == 0
    assert rows[3].z == pytest.approx(1831.1, abs=0.1)  # √W, with a probability far below the smallest double
    assert rows[3].mk_z > 100
    assert "<1e-300" in solution.report()


def test_mignard_and_klioners_w_is_power_over_the_zonal_variance():
    solution = next(skies(1, TRUTH))
    row = fit.spectrum.spectrum(solution)[4]
    zonal = solution.modes.slice_of("S", 2).start
    assert row.mk_w == pytest.approx(solution.coefficients.power("S", 2) / solution.sigma[zonal] ** 2)


def test_limit_is_that_of_a_norm_with_the_mean_error():
    """Where there is nothing: noise is the sum of squares of 2l + 1 errors."""
    for row in fit.spectrum.spectrum(next(skies(1, TRUTH))):
        n = 2 * row.l + 1
        of_one = fit.quality.norm_limit(np.zeros(1), np.ones(1), n)[0]
        assert row._replace(power=0.0).limit() == pytest.approx(of_one**2 * row.noise / n)


@few_or_many(30, 300, "draws")
@pytest.mark.parametrize("over_noise", [0.0, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.3, 1.0, 3.0, 10.0))])
def test_limits_hold_on_a_cut_sky(over_noise, draws):
    """Coefficients of one error or not, correlated or not: as often as they say, or more where there is little."""
    solution = next(skies(1, TRUTH))
    noise = np.linalg.cholesky(solution.covariance)
    rng = np.random.default_rng(1)
    for row in fit.spectrum.spectrum(solution):
        place = solution.modes.slice_of(row.kind, row.l)
        weight = solution.modes.norm2[place]
        true = rng.normal(size=(draws, 2 * row.l + 1))
        true *= np.sqrt(over_noise * row.noise / np.sum(weight * true**2, 1))[:, None]
        found = true + (rng.normal(size=(draws, len(noise))) @ noise.T)[:, place]
        limits = np.array([row._replace(power=power).limit() for power in np.sum(weight * found**2, 1)])
        held = np.mean(limits >= over_noise * row.noise)
        assert held > 0.95 - 4 * np.sqrt(0.05 * 0.95 / draws)
        if over_noise == 10 and draws == 300:
            assert held < 0.995
