"""Clipping."""

from dataclasses import replace

import numpy as np
import pytest

import fit
import sim
from fit.robust import _clip
from vsh import Field, Modes
from vsh.tools.errors import ConvergenceError

TRUTH = sim.spin((1, 2, 3)) + sim.acceleration((0, 4, 0))
N = 20_000


def noisy(seed, outliers=0):
    population = sim.Population(*sim.uniform_sky(N, rng=seed), None)
    field = sim.observe(population, TRUTH, seed, sigma=[[30.0], [20.0]], rho=0.5)
    motion = field.motion.copy()
    motion[0, :outliers] += 1000.0
    return Field(field.lon, field.lat, motion, field.sigma, field.rho)


@pytest.mark.parametrize("kappa", [1.5, 2.0, 3.0])
def test_gaussian_errors_lose_two_to_the_minus_kappa_squared(kappa):
    clipped = fit.robust.clip(noisy(1), Modes(1), kappa=kappa)
    expected = 2.0 ** -(kappa**2)
    lost = 1 - clipped.kept.mean()
    # Binomial scatter, and that of the median: 1.6 % of itself moves the count by as much again.
    assert abs(lost - expected) < 4 * np.sqrt(expected / N) * 2


def test_outliers_are_left_out_and_said():
    clipped = fit.robust.clip(noisy(2, outliers=400), Modes(1), kappa=4)
    assert not clipped.kept[:400].any()
    assert clipped.kept[400:].mean() > 0.999
    found = clipped.solution
    assert np.abs((found.spin.value - [1, 2, 3]) / found.spin.sigma).max() < 4
    spoilt = fit.fit_field(noisy(2, outliers=400), 1)
    assert np.abs((spoilt.spin.value - [1, 2, 3]) / spoilt.spin.sigma).max() > 10
    assert any("clipped 40" in note and "κ = 4" in note for note in found.notes)


def test_absolute_threshold():
    field = noisy(3)
    clipped = fit.robust.clip(field, Modes(1), threshold=2.0)
    x = np.sqrt(clipped.solution.residuals(field).chi2)
    np.testing.assert_array_equal(clipped.kept, x <= 2.0)
    # P(X > 2) = exp(−2)
    assert 1 - clipped.kept.mean() == pytest.approx(np.exp(-2), abs=0.01)


def test_source_may_come_back():
    """Beside huge outliers of one sign the first fit throws out good sources; they return."""
    field = noisy(4, outliers=3000)
    clipped = fit.robust.clip(field, Modes(1), threshold=5.0)
    first = np.sqrt(fit.fit_field(field, 1).residuals(field).chi2) <= 5.0
    assert (clipped.kept & ~first).sum() > 100
    assert clipped.n_rounds > 2


def test_unsettled_clip_is_never_returned():
    with pytest.raises(ConvergenceError, match="not settled after 1 rounds"):
        fit.robust.clip(noisy(5, outliers=100), Modes(1), max_rounds=1)
    with pytest.raises(ValueError, match="kappa must be above zero"):
        fit.robust.clip(noisy(5), Modes(1), kappa=0)


def test_clip_in_circles_says_so(monkeypatch):
    """Two sets of sources that send for one another."""
    field = noisy(6)[:1000]
    far = {"one": np.r_[np.full(500, 1.0), np.full(500, 9.0)], "two": np.r_[np.full(500, 9.0), np.full(500, 1.0)]}
    solutions = iter(["one", "two"] * 4)
    monkeypatch.setattr(_clip, "solve", lambda normal: next(solutions))
    monkeypatch.setattr(_clip, "_compute_distances", lambda field, solution: far[solution])
    with pytest.raises(
        ConvergenceError, match="oscillates after 3 rounds: 1000 sources are alternately clipped and kept"
    ):
        fit.robust.clip(field, Modes(1), threshold=5.0)


def test_excess_noise_of_any_size():
    """On stars that scatter by 264 times their errors it ended in a word of SciPy's."""
    rng = np.random.default_rng(3)
    lon, lat = sim.uniform_sky(1500, rng)
    for size in (0.0, 1.0, 300.0, 8000.0, 1e6):
        sigma = 10 ** rng.uniform(1, 2, (2, 1500))
        found = fit.robust.excess_noise(Field(lon, lat, rng.normal(size=(2, 1500)) * np.hypot(sigma, size), sigma), 1)
        assert abs(found.excess_noise - size) < 5 * found.excess_noise_error


def test_one_motion_that_is_off_by_millions_of_errors():
    """The first fit by least squares lies far from all others: weights begin at zero then, and floor and errors hold."""
    sigma = 100 * np.exp(np.random.default_rng(1).normal(size=300)) * np.ones((2, 1))
    field = sim.observe(sim.quasars(300, 1), sim.spin((0, 0, 0)), 2, sigma=sigma)
    motion = field.motion.copy()
    motion[0, np.argmin(sigma[0])] = 1e12
    clean, wrong = (fit.recommended(each).solution for each in (field, replace(field, motion=motion)))
    np.testing.assert_allclose(wrong.sigma, clean.sigma, rtol=0.5)  # without the most precise source
    assert np.abs((wrong.values - clean.values) / clean.sigma).max() < 0.5


def test_one_source_with_most_of_the_weight_is_named():
    field = sim.observe(sim.quasars(300, 1), sim.spin((0, 0, 0)), 2, sigma=100.0)
    sigma = field.sigma.copy()
    sigma[:, 7] = 1e-3
    notes = [str(note) for note in fit.fit_field(field.with_errors(sigma), 1).notes]
    assert any("source 7 has 100 % of the weight of all sources" in note for note in notes)
    assert "source 7 has 100 % of the weight" in dict(fit.fit_field(field.with_errors(sigma), 1).answer.lines)["doubt"]
    assert not any("of the weight" in str(note) for note in fit.fit_field(field, 1).notes)
