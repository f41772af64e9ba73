"""Equations of some sources by the weights of a robust fit of all."""

import numpy as np
import pytest

import fit
import sim
from fit.redshift import binned
from fit.robust import student_t
from vsh import ParameterError


def heavy(quasars, rng, acceleration=(0, 0, 0)):
    """Motions with the tails of Student's t of ν = 2, whose errors are half of some."""
    field = sim.observe(quasars, sim.acceleration(acceleration), rng=rng, sigma=200.0)
    noise = rng.standard_t(2, size=(2, len(field))) * field.sigma * rng.choice([1, 2.0], size=len(field))
    truth = sim.acceleration(acceleration)(field.lon, field.lat)
    return field.minus(field.motion - truth - noise)


@pytest.mark.parametrize("part", [0.25, pytest.param(0.5, marks=pytest.mark.slow)])
def test_vector_of_a_class_is_not_drawn_to_that_of_all(part):
    """Weights are taken about the fit of all: without a correction the difference was a third too small."""
    rng, quasars, seen, errors = np.random.default_rng(2), sim.quasars(2000, 3), [], []
    for _ in range(30):
        field = heavy(quasars, rng)
        here = np.arange(len(field)) < part * len(field)
        moved = field.minus(np.where(here, -1.0, 0.0) * sim.acceleration((0, 60, 0))(field.lon, field.lat))
        fitted = student_t(moved, 1)
        one, rest = (fit.solve(fitted.equations(moved[chosen], 1)) for chosen in (here, ~here))
        seen.append(one.acceleration.value[1] - rest.acceleration.value[1])
        errors.append(np.hypot(one.acceleration.sigma[1], rest.acceleration.sigma[1]))
    assert np.mean(seen) == pytest.approx(60, abs=3 * np.std(seen) / np.sqrt(len(seen)))
    assert np.std(seen) / np.mean(errors) == pytest.approx(1, abs=0.3)


def test_whole_has_the_solution_of_the_fit():
    field = heavy(sim.quasars(1000, 3), np.random.default_rng(1), (0, 100, 0))
    fitted = student_t(field, 2, tolerance=1e-9)
    np.testing.assert_allclose(fit.solve(fitted.equations(field, 2)).values, fitted.solution.values, atol=1e-5)


@pytest.mark.slow
def test_bins_of_redshift_by_each_estimator():
    """p-values of bins that do not differ, errors half as large and tails heavy; and what no bins are fitted by."""
    rng, quasars, p = np.random.default_rng(5), sim.quasars(1500, 3), []
    for _ in range(40):
        field = heavy(quasars, rng)
        bins = binned(field, 1, 3, method="student")
        assert (bins.scales == 1).all()
        p += [bins.equality(kind, 1).p_value for kind in "TS"]
    assert np.mean(np.array(p) < 0.05) < 0.13
    assert 0.3 < np.mean(p) < 0.7
    assert "each bin has the weights of its own fit (student)" in bins.report()
    clipped = binned(field, 1, 3, method="clip", value=3)
    assert clipped.counts.sum() < 1500
    for method in ("bootstrap", "jackknife"):
        with pytest.raises(ParameterError, match="bins take least-squares"):
            binned(field, 1, 3, method=method)
    galaxies = sim.observe(sim.galaxies(600, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
    with pytest.raises(ParameterError, match="share flows: their bins are fitted by least-squares, not student"):
        binned(galaxies, 1, 2, method="student")


def test_many_sources_settle_in_few_rounds():
    """By Newton's steps: to where the weights alone move nothing, and in fewer rounds than they need."""
    rng, quasars = np.random.default_rng(4), sim.quasars(25_000, 3)
    field = heavy(quasars, rng, (0, 20, 0))
    fitted = student_t(field, 2)
    assert fitted.n_rounds <= 7
    weighted = field.with_errors(field.sigma / np.sqrt(fitted.weights))
    again = fit.solve(fit.normal_equations(weighted, 2))
    assert np.max(np.abs(again.values - fitted.solution.values) / again.sigma) < 1e-4
