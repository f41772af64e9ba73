"""How an acceleration moves: the p-values are uniform where nothing is wrong."""

import numpy as np
import pytest
from conftest import few_or_many
from scipy.stats import kstest

import sim
from fit import fit_field, normal_equations
from fit.background import floor
from study.referee._quasars import (
    find_degree_shift,
    find_method_shift,
    find_most_influential_source,
    select_degree_coefficients,
)
from vsh import Field
from vsh.models.covariance import Spectrum

RNG = np.random.default_rng(5)
N = 900
LON, LAT = RNG.uniform(0, 2 * np.pi, N), np.arcsin(RNG.uniform(-0.9, 1, N))
SIGMA, RHO = RNG.uniform(20, 200, (2, N)), RNG.uniform(-0.6, 0.6, N)


def sky(rng, n=N, factor=1.0):
    x, y = rng.standard_normal((2, n))
    motion = factor * SIGMA[:, :n] * [x, RHO[:n] * x + np.sqrt(1 - RHO[:n] ** 2) * y]
    return Field(LON[:n], LAT[:n], motion, SIGMA[:, :n], RHO[:n])


@pytest.mark.slow
def test_by_degree_is_exact():
    """The move is that of the two fits, its covariance what skies scatter by."""
    field = sky(np.random.default_rng(1))
    move, error, _ = find_degree_shift(field, 2, 5, None)
    fits = [fit_field(field, lmax).acceleration.value for lmax in (5, 2)]
    np.testing.assert_allclose(move, fits[0] - fits[1], atol=1e-9)
    seen = [find_degree_shift(sky(np.random.default_rng(k)), 2, 5, None) for k in range(150)]
    moves, p = np.array([each[0] for each in seen]), [each[2] for each in seen]
    np.testing.assert_allclose(moves.std(0), error, rtol=0.2)
    assert kstest(p, "uniform").pvalue > 0.01


@pytest.mark.slow
@few_or_many(24, 120)
def test_by_degree_knows_what_sources_share(n_skies):
    p, plain = [], []
    for seed in range(n_skies):
        shared = sim.systematics(40 * Spectrum.flat(), seed)(LON, LAT)
        field = sky(np.random.default_rng(seed))
        field = Field(LON, LAT, field.motion + shared, SIGMA, RHO)
        p.append(find_degree_shift(field, 2, 6, floor(normal_equations(field, 6)))[2])
        plain.append(find_degree_shift(field, 2, 6, None)[2])
    # One sky in ten with so little to tell the floor by, and without it more than one in four.
    assert np.mean(np.array(p) < 0.05) < 0.1 + 2.5 * np.sqrt(0.1 * 0.9 / n_skies)
    assert np.mean(np.array(plain) < 0.05) > np.mean(np.array(p) < 0.05)
    assert np.mean(np.array(plain) < 0.05) > 0.28 - 2.5 * np.sqrt(0.28 * 0.72 / n_skies)


@pytest.mark.slow
def test_by_source():
    """Uniform where errors are right, and found where one source is not."""
    p = [find_most_influential_source(sky(np.random.default_rng(k)), 2)[2] for k in range(120)]
    assert kstest(p, "uniform").pvalue > 0.01
    p = [find_most_influential_source(sky(np.random.default_rng(k), factor=1.7), 2)[2] for k in range(60)]
    assert kstest(p, "uniform").pvalue > 0.01
    # Systematic errors beyond the degree of the fit is scatter of the best ones.
    p = []
    for seed in range(60):
        shared = sim.systematics(15 * Spectrum.flat(), seed)(LON, LAT)
        motion = sky(np.random.default_rng(seed)).motion + shared
        p.append(find_most_influential_source(Field(LON, LAT, motion, SIGMA, RHO), 2)[2])
    assert np.mean(np.array(p) < 0.05) < 0.12
    field = sky(np.random.default_rng(3))
    motion = field.motion.copy()
    best = int(np.argmin(SIGMA.sum(0)))
    motion[:, best] += 8 * SIGMA[:, best]
    row, size, p_value = find_most_influential_source(Field(LON, LAT, motion, SIGMA, RHO), 2)
    assert row == best
    assert size > 0.5
    assert p_value < 1e-3


def test_by_source_is_the_move_when_it_is_left_out():
    field = sky(np.random.default_rng(8))
    row, size, _ = find_most_influential_source(field, 2)
    kept = np.delete(np.arange(N), row)
    whole, rest = (fit_field(each, 2).acceleration for each in (field, field[kept]))
    away = whole.value - rest.value
    assert np.sqrt(away @ np.linalg.solve(whole.covariance, away)) == pytest.approx(size, rel=0.1)


@pytest.mark.slow
@few_or_many(12, 60, "skies")
def test_by_method_asks_nothing_of_the_errors(monkeypatch, skies):
    """Errors wrong by a factor, tails: uniform; motions of one kind of source that only robust fits see: found."""
    monkeypatch.setattr("study.referee._quasars._MIN_GROUP_SIZE", 40)
    for tails in (False, True):
        p = []
        for seed in range(skies):
            rng = np.random.default_rng(seed)
            field = sky(rng, factor=2.0)
            if tails:
                field = Field(LON, LAT, rng.standard_t(3, (2, N)) * SIGMA, SIGMA, RHO)
            p.append(find_method_shift(field, seed)[2])
        assert kstest(p, "uniform").pvalue > 0.01


def test_coefficients_of_one_degree():
    field = sim.observe(sim.quasars(300, 1), sim.spin((1.0, 2.0, 3.0)), 2, sigma=30.0)
    solution = fit_field(field, 3)
    values, covariance = select_degree_coefficients(solution, 2)
    rows = [i for i, mode in enumerate(solution.modes) if mode.l == 2]
    assert len(rows) == 10
    np.testing.assert_array_equal(values, solution.values[rows])
    np.testing.assert_array_equal(covariance, solution.covariance[np.ix_(rows, rows)])
