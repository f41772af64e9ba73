"""The recommended fit: one answer in Python and on the command line, to the degree that the sources bear."""

import numpy as np
import pytest
from conftest import random_field

import fit
import sim
from fit.commands.fit import main
from fit.methods import degree_for
from vsh import Field
from vsh.tools.errors import ConvergenceError, DegeneracyError, ParameterError, TableError

TRUTH = np.array([0.0, 60.0, -40.0])


@pytest.fixture(scope="module")
def quasars():
    return sim.observe(sim.quasars(1500, 1), sim.acceleration(TRUTH), rng=2, sigma=300.0)


def test_truth_is_within_its_errors(quasars):
    answer = fit.recommended(quasars)
    away = answer.acceleration.value - TRUTH
    assert away @ np.linalg.solve(answer.acceleration.covariance, away) < 16
    assert answer.spin.p_value > 1e-3
    # Systematic errors is in the errors, and not in those of the plain fit.
    assert (answer.acceleration.sigma >= answer.plain.acceleration.sigma).all()
    assert answer.acceleration.p_value < 0.0027 < answer.spin.p_value


def test_command_says_the_same(quasars, tmp_path, capsys):
    quasars.write(tmp_path / "q.fits")
    assert main([str(tmp_path / "q.fits"), "--format", "none"]) == 0
    assert capsys.readouterr().out.startswith(fit.recommended(quasars).verdict + "\n")


def test_outliers_and_wrong_errors_do_not_carry_it(quasars):
    """A fortieth of the sources are stars that move by 20 times the errors; all errors are half of what they should be."""
    rng = np.random.default_rng(3)
    motion, star = np.array(quasars.motion), rng.uniform(size=len(quasars)) < 0.025
    motion[:, star] += 6000 * rng.normal(size=(2, star.sum()))
    bad = Field(quasars.lon, quasars.lat, motion, quasars.sigma / 2)
    answer, plain = fit.recommended(bad).acceleration, fit.fit_field(bad, 5).acceleration
    clean = fit.recommended(quasars).acceleration
    assert np.mean(answer.sigma) < 1.2 * np.mean(clean.sigma)
    assert np.linalg.norm(answer.value - clean.value) < 0.3 * np.linalg.norm(plain.value - clean.value)


def test_noise_of_many_sources_is_that_of_a_sample(monkeypatch):
    """Errors a third of what they should be over two decades: the noise of a sample gives the fit that all would."""
    rng, n = np.random.default_rng(4), 12_000
    lon, lat = sim.uniform_sky(n, rng)
    sigma = np.broadcast_to(10 ** rng.uniform(1, 3, n), (2, n))
    field = Field(lon, lat, 3 * sigma * rng.normal(size=(2, n)) + sim.acceleration(TRUTH / 10)(lon, lat), sigma)
    whole = fit.recommended(field, 2)
    for name, value in (("fit.methods._MANY_SOURCES", 10_000), ("fit.robust._reweight._MANY", 9_000),
                        ("fit.robust._reweight._SAMPLE", 1_500)):  # fmt: skip
        monkeypatch.setattr(name, value)
    sampled = fit.recommended(field, 2)
    assert sampled.weights.noise > 0
    one, two = sampled.acceleration, whole.acceleration
    np.testing.assert_allclose(one.value, two.value, atol=two.sigma.max())
    np.testing.assert_allclose(one.sigma, two.sigma, rtol=0.15)
    assert np.abs((one.value - TRUTH / 10) / one.sigma).max() < 4


def test_many_sources_at_one_place_are_no_sample(monkeypatch):
    rng = np.random.default_rng(5)
    field = random_field(200, 1)[rng.integers(0, 2, 3000) * 150]
    monkeypatch.setattr("fit.robust._reweight._MANY", 1000)
    monkeypatch.setattr("fit.robust._reweight._SAMPLE", 500)
    field = random_field(900, 2) + field
    assert np.isfinite(fit.robust.student_t(field, 1).solution.sigma).all()


@pytest.mark.parametrize("n", [15, 40, 150])
def test_few_sources_lower_the_degree_and_say_so(n):
    answer = fit.recommended(random_field(n, 1))
    assert answer.solution.modes.lmax == degree_for(n, 5)
    assert np.isfinite(answer.acceleration.sigma).all()
    assert (answer.floor is None) == (answer.solution.modes.lmax < 3)
    lowered = [str(note) for note in answer.solution.notes if "instead of 5" in str(note)]
    assert bool(lowered) == (answer.solution.modes.lmax < 5)


def test_part_of_the_sky_lowers_the_degree():
    """Within 15° of a pole degree 5 cannot be told from lower ones."""
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 400), np.arcsin(rng.uniform(np.cos(np.radians(15)), 1, 400))
    answer = fit.recommended(Field(lon, lat, 30 * rng.normal(size=(2, 400)), np.full((2, 400), 30.0)))
    assert answer.solution.modes.lmax < 5
    assert any("see too little of the sky" in str(note) for note in answer.solution.notes)
    assert np.isfinite(answer.spin.covariance).all()


def test_bad_arguments(quasars):
    with pytest.raises(ParameterError, match="lmax"):
        fit.recommended(quasars, 0)
    with pytest.raises(TableError, match="no such file"):
        fit.recommended("nowhere.fits")
    with pytest.raises(DegeneracyError):
        fit.recommended(quasars[:2])
    with pytest.raises(DegeneracyError, match="do not bear degree 3"):
        degree_for(20, 5, least=3)


def noise(seed, n, decades=0, scatter=0.0):
    """Sources without a signal, whose errors are of so many decades about 100, and which scatter by more than these."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 100 * 10 ** (decades * (rng.random(n) - 0.5)) * np.ones((2, 1))
    return Field(lon, lat, np.hypot(sigma, scatter) * rng.normal(size=(2, n)), sigma)


@pytest.mark.parametrize(
    ("n", "decades", "scatter"), [(15, 0, 30), (36, 0, 30), (40, 4, 0.3), (40, 4, 300), (60, 3, 3), (100, 4, 30)]
)
def test_few_sources_without_a_signal_are_not_a_detection(n, decades, scatter):
    """Errors that say little of the scatter: benchmarks/recommended.py has all cells, with 200 skies each."""
    pulls, p_values = [], []
    for seed in range(12):
        result = fit.recommended(noise([seed, n, decades], n, decades, 100 * scatter))
        for vector in (result.spin, result.acceleration):
            pulls += [*(vector.value / vector.sigma)]
            p_values.append(vector.p_value)
    assert np.nanmin(p_values) > 1e-4  # of 24; a fit through the most precise sources had 1e-10 and less
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.3  # 72 pulls: ± 0.08


@pytest.mark.parametrize(("n", "decades", "scatter"), [(33, 0, 30), (40, 4, 3), (60, 3, 3)])
def test_students_t_has_no_errors_where_a_few_sources_decide(n, decades, scatter):
    """A third to four fifths of its 95 % intervals did not hold zero."""
    found = fit.estimate(noise(n, n, decades, 100 * scatter), 1, "student").solution
    assert np.isnan(found.acceleration.sigma).all()
    assert np.isnan(found.acceleration.p_value)
    assert "no result" in str(found.answer)


def test_no_error_is_printed_where_nothing_is_left_to_tell_it():
    """Three sources and six unknowns: errors of zero were printed."""
    for n in (3, 4):
        result = fit.recommended(noise(n, n))
        assert np.isnan([result.spin.amplitude_error, result.spin.amplitude_limit(), result.spin.p_value]).all()
        assert "no result" in result.verdict
    # Eight numbers less six unknowns: of as many as the scores alone suggest, three, errors would be printed.
    assert fit.robust.excess_noise(noise(4, 4), 1).solution.covariance_dof == 2


@pytest.mark.parametrize(("n", "lmax", "decades"), [(60, 3, 4), (80, 3, 4), (60, 2, 4), (100, 2, 4)])
def test_students_t_of_few_sources_detects_nothing_at_higher_degrees(n, lmax, decades):
    """Of a degree of freedom for fewer than all coefficients, p < 0.0027 came out on 14 to 44 % of skies."""
    p_values = []
    for seed in range(15):
        found = fit.estimate(noise(seed, n, decades, 30.0), lmax, "student").solution
        p_values += [found.spin.p_value, found.acceleration.p_value]
    assert np.sum(np.array(p_values) < 0.0027) <= 1
    # Right errors are left alone.
    assert np.isfinite(fit.estimate(noise(1, n), lmax, "student").solution.spin.p_value)


def test_it_is_the_same_in_all_axes():
    """The floor of errors from residuals was by the mean of ratios along the axes."""
    field = sim.observe(sim.quasars(800, 3, "plane-avoiding"), sim.acceleration((0, -4, -3)), 4, sigma=60.0)
    one, other = fit.recommended(field), fit.recommended(field.to_frame("galactic"))
    assert other.acceleration.p_value == pytest.approx(one.acceleration.p_value, rel=1e-6)
    assert other.floor.acceleration_error == pytest.approx(one.floor.acceleration_error, rel=1e-6)
    turned = other.acceleration.to_frame("icrs")
    assert turned.sigma == pytest.approx(one.acceleration.sigma, rel=1e-6)


def test_several_rows_a_source_are_no_sample(quasars):
    """Pulsars in a compilation: each measured a few times, with a motion of its own that all of its rows share."""
    few = quasars[:40]
    motion = few.motion + 5000 * np.random.default_rng(5).normal(size=(2, 40))
    rows = np.repeat(np.arange(40), 4)
    few = Field(few.lon, few.lat, motion, few.sigma)
    assert "no result: 120 of 160 rows are at the place of another" in fit.recommended(few[rows], 1).verdict
    assert "no result" in fit.estimate(few[rows], 1, "excess-noise").answer.sentence
    assert "at the place" not in fit.recommended(few, 1).verdict
    some = np.r_[np.arange(1500), np.arange(100)]  # a catalogue with a few sources twice
    again = fit.recommended(quasars[some])
    assert "no result" not in again.verdict
    assert any("100 of 1600 rows are at the place of another" in note for note in again.solution.notes)


def test_errors_of_least_squares_in_place_of_a_robust_fit_are_scaled(quasars, monkeypatch):
    def fail(*args, **keywords):
        raise ConvergenceError("no weights")

    monkeypatch.setattr("fit.methods.student_t", fail)
    wrong = Field(quasars.lon, quasars.lat, quasars.motion, quasars.sigma / 20)
    answer = fit.recommended(wrong, 1)
    assert answer.weights is None
    assert answer.solution.error_source == "catalogue, scaled"
    assert "times the formal errors" in answer.answer.sentence
