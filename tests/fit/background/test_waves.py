"""The limit on gravitational waves: published numbers, ranks of known truths, other ways to the same quantile."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_field, real_catalogue
from scipy.stats import chi2, kstest, ncx2

import fit
import sim
from fit.background import Spectrum, wave_limit
from fit.background._amplitude import Amplitude
from fit.background._waves import compute_probability_above, find_sum_quantile, fit_quadrupole
from vsh.io.catalogue import read_field
from vsh.tools.errors import ModesError, ParameterError

# 95 % limits on h70² Ω from the VLBA table: coefficients flat, flat in Ω, flat in √Ω; the first as Jaraba et al. (2023) have
# it, who find 0.024. Errors scaled, clipped at κ = 3 and 2, plain.
VLBA = [
    (None, True, (0.0229, 0.0357, 0.0270)), (3, True, (None, 0.0264, 0.0199)), (2, True, (None, 0.0160, 0.0111)),
    (3, False, (0.0135, None, None)), (2, False, (0.0111, None, None)), (None, False, (0.0123, 0.0342, 0.0278)),
]  # fmt: skip


def rank(amplitude, value):
    """The probability of a smaller amplitude, with a flat prior."""
    return float(np.interp(np.sqrt(value), *amplitude._integrate_posterior("flat")))


@pytest.mark.parametrize(("kappa", "scaled", "limits"), VLBA)
def test_vlba_table(kappa, scaled, limits):
    field = read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    if kappa:
        field = field[fit.clip(field, 2, kappa).kept]
    found = wave_limit(fit.normal_equations(field, 2), noise_scale=scaled)
    for prior, limit in zip(("coefficients", "flat", "root"), limits, strict=True):
        if limit is not None:
            assert found.limit(0.95, prior) == pytest.approx(limit, rel=0.02)
    assert kappa or found.power == pytest.approx(21.09, abs=0.01)
    assert kappa or scaled or found.noise_power == pytest.approx(1.64, abs=0.01)


def test_more_degrees_make_a_false_detection_larger_without_systematics():
    field = read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    normal = fit.normal_equations(field, 4)
    likeliest = [wave_limit(normal, range(2, l + 1), noise_scale=False, systematics=[]).maximum for l in (2, 3, 4)]
    np.testing.assert_allclose(likeliest, [0.009, 0.074, 0.63], rtol=0.05)
    allowed = [wave_limit(normal, range(2, l + 1)).limit() for l in (2, 3, 4)]
    assert max(allowed) < 0.06


def injected(omega, seed, n=2000, sigma=50.0, lmax=3):
    signal = sim.wave_background(omega, seed, lmax=lmax) + sim.spin((3, -2, 1))
    return fit.normal_equations(sim.observe(sim.quasars(n, 7), signal, seed + 10_000, sigma=sigma), lmax)


@pytest.mark.slow
def test_ranks_of_known_truths_are_uniform():
    """500 Ω drawn flat, each put on a sky of waves in degrees 2 and 3: its rank in the posterior."""
    rng, ranks = np.random.default_rng(5), []
    for seed in range(500):
        omega = rng.uniform(0, 0.6)
        found = wave_limit(injected(omega, seed), (2, 3), systematics=[])
        inside = found.amplitude.root[-1] ** 2 > 0.6  # the prior ends where the truths do
        edge = rank(found.amplitude, 0.6) if inside else 1.0
        ranks.append(rank(found.amplitude, omega) / edge)
    assert kstest(ranks, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_without_waves_intervals_begin_at_zero():
    """200 skies without waves: at least 68 and 95 % of the intervals include zero, and limits cover."""
    found = [wave_limit(injected(0.0, seed)) for seed in range(200)]
    assert np.mean([each.interval[0] == 0 for each in found]) > 0.68
    assert np.mean([each.amplitude.interval(0.95)[0] == 0 for each in found]) > 0.95
    assert np.mean([each.limit(0.95, "root") for each in found]) < np.mean([each.limit() for each in found])


@pytest.mark.slow
def test_errors_that_are_wrong_by_place():
    """120 skies without waves, errors four times too small on half of each: the robust fit's intervals cover zero."""
    quasars, away = sim.quasars(1000, 7), {"plain": 0, "robust": 0}
    for seed in range(120):
        field = sim.observe(quasars, sim.spin((3, -2, 1)), seed, sigma=50.0)
        field = field.with_errors(np.where(field.lon < np.pi, field.sigma / 4, field.sigma))
        for name, found in (("plain", fit.normal_equations(field, 2)), ("robust", fit.robust.student_t(field, 2))):
            away[name] += wave_limit(found).amplitude.interval(0.95)[0] > 0
    assert away["robust"] <= 9
    assert away["plain"] <= 20


def test_waves_are_recovered():
    found = wave_limit(injected(2.0, 3, sigma=20.0), (2, 3), systematics=[])
    low, high = found.amplitude.interval(0.95)
    assert low < 2.0 < high
    assert 0 < found.interval[0] < found.maximum < found.interval[1] < found.limit()
    assert found.likelihood(found.maximum) == pytest.approx(1, abs=1e-3)
    assert found.likelihood([0.0, 1e9]).max() < 1e-3
    assert found.parity_p_value > 0.001
    other = wave_limit(injected(2.0, 3, sigma=20.0), (2, 3), systematics=[], hubble=100.0)
    assert other.maximum == pytest.approx(0.49 * found.maximum, rel=1e-3)


def test_priors():
    found = wave_limit(injected(0.0, 1))
    flat, root, log = (found.limit(0.95, prior) for prior in ("flat", "root", "log"))
    assert log < root < flat
    assert found.limit(0.95, "log", lowest=flat / 1e9) < log
    assert found.limit(0.68) < flat
    root = np.linspace(0, found.amplitude.root[-1], 200_001)[1:]
    for prior, power in (("flat", 1), ("root", 0)):
        mass = np.cumsum(found.likelihood(root**2) * root**power)
        assert np.interp(0.95 * mass[-1], mass, root) ** 2 == pytest.approx(found.limit(0.95, prior), rel=5e-3)


def test_strain_and_band():
    """h_c = √(3Ω/2) H0/(π f), H0 = 2.2685e-18/s; at 22.6 yr and 34 months."""
    found = wave_limit(injected(0.0, 1))
    assert found.frequency(22.6) == pytest.approx(1.4e-9, rel=0.01)
    assert found.frequency(34 / 12) == pytest.approx(11.2e-9, rel=0.01)
    expected = np.sqrt(1.5 * found.limit()) * 2.2685455e-18 / (np.pi * found.frequency(10))
    assert found.strain(10) == pytest.approx(expected, rel=1e-6)
    assert "f < 1/T = 3.17 nHz (T = 10 yr)" in replace(found, years=10).report()
    assert "T the time over which the motions were measured" in found.report()


def test_quadratic_forms():
    """Equal terms are χ², central or not; unequal ones against a million draws."""
    ones, shifts = np.ones(10), np.full(10, 0.6)
    for x in (3.0, 12.0, 40.0):
        assert compute_probability_above(x, ones, 0 * ones) == pytest.approx(chi2.sf(x, 10), abs=1e-6)
        assert compute_probability_above(x, ones, shifts) == pytest.approx(ncx2.sf(x, 10, 3.6), abs=1e-6)
    rng = np.random.default_rng(1)
    variances, shifts = rng.uniform(0.1, 5, 10), rng.normal(size=10)
    draws = np.sum(variances * (rng.normal(size=(10**6, 10)) + shifts) ** 2, 1)
    for probability in (0.05, 0.5, 0.95):
        assert find_sum_quantile(probability, variances, shifts) == pytest.approx(
            np.quantile(draws, probability), rel=5e-3
        )


def test_messages():
    normal = injected(0.0, 1)
    with pytest.raises(ModesError, match="no power in degree 1"):
        wave_limit(normal, (1, 2))
    with pytest.raises(ModesError, match="degree 4 is not fitted"):
        wave_limit(normal, (4,))
    found = wave_limit(normal)
    with pytest.raises(ParameterError, match="prior must be one of"):
        found.limit(0.95, "none")
    with pytest.raises(ParameterError, match="probability must lie between 0 and 1"):
        found.limit(95)
    few = wave_limit(fit.normal_equations(random_field(7, 1), 2), noise_scale=False, systematics=[Spectrum.flat()])
    with pytest.raises(ParameterError, match="do not determine every coefficient of degree 2"):
        few.limit(0.95, "coefficients")
    assert few.report().rstrip().endswith("–")
    few.plot()
    # As many numbers as unknowns determine no scatter, whatever the matrix is.
    assert np.isnan(fit_quadrupole(fit.normal_equations(random_field(8, 1), 2), 2, True)[0])


def test_limit_by_coefficients_goes_with_the_square_of_the_hubble_constant():
    found = wave_limit(injected(0.0, 1))
    other = replace(found, hubble=2 * found.hubble)
    assert found.limit(0.95, "coefficients") == pytest.approx(4 * other.limit(0.95, "coefficients"))


def test_likeliest_amplitude_at_the_ends_of_its_grid():
    root = np.array([3.0, 4.0, 5.0])
    for log_likelihood, at in (([0.0, -1, -2], 9), ([-2.0, -1, 0], 25), ([-1.0, 0, -1], 16)):
        assert Amplitude(root, np.array(log_likelihood)).maximum == pytest.approx(at)
