"""One rule on χ², by significance."""

import re

import numpy as np
import pytest
from conftest import ROOT
from scipy import stats

import fit
import sim
from fit.results.quality import Quality, f_p_value, log_p_value, normal_deviate
from vsh import Field


@pytest.mark.parametrize(
    ("reduced", "dof", "deviations"), [(1.435, 5610, 21.3), (0.965, 199_994, -11.2), (1.435, 20, 1.317)]
)
def test_significance_counts_not_size(reduced, dof, deviations):
    """Nothing below 1.5 was remarked on, however many degrees of freedom."""
    found = Quality(reduced * dof, dof)
    assert found.deviations == pytest.approx(deviations, rel=0.05)
    assert found.contradicted == (abs(deviations) > 3)
    assert (found.warning() is None) == (abs(deviations) < 3)
    assert found.factor == pytest.approx(np.sqrt(reduced) if abs(deviations) > 3 else 1.0)


def test_deviates_are_those_of_scipy_and_never_infinite():
    for chi2, dof in ((0.1, 3), (3, 3), (40, 3), (9000, 8000), (7000, 8000)):
        upper = stats.norm.isf(stats.chi2.sf(chi2, dof))
        expected = upper if chi2 > dof else stats.norm.ppf(stats.chi2.cdf(chi2, dof))
        assert normal_deviate(chi2, dof) == pytest.approx(expected, abs=1e-6)
    assert log_p_value(700, 5) == pytest.approx(stats.chi2.logsf(700, 5), rel=1e-9)
    assert 50 < normal_deviate(3000, 3) < np.sqrt(3000)  # once "inf" above 1430
    assert np.isfinite(normal_deviate(1e9, 7))
    assert f_p_value(20.0, 5, 30) == pytest.approx(stats.f.sf(4.0, 5, 30))
    assert f_p_value(20.0, 5, np.inf) == pytest.approx(stats.chi2.sf(20, 5))


def test_rule_errs_as_often_as_it_says():
    """χ² of 2000 sets of right errors: 3 σ twice in 740."""
    rng = np.random.default_rng(1)
    for dof in (5, 500):
        share = np.mean([Quality(x, dof).contradicted for x in rng.chisquare(dof, 4000)])
        assert share < 0.007


def test_reports_warn():
    rng = np.random.default_rng(2)
    lon, lat = sim.uniform_sky(400, rng)
    field = Field(lon, lat, 13 * rng.normal(size=(2, 400)), np.full((2, 400), 10.0))
    text = fit.fit_field(field, 1).report()
    assert "the residuals suggest errors 1." in text
    assert "not scaled" in text
    good = fit.fit_field(field.with_errors(field.sigma * 1.3), 1).report()
    assert "warning" not in good
    large = fit.fit_field(field.with_errors(field.sigma * 3), 1).report()
    assert "the errors seem too large" in large


def test_few_degrees_of_freedom_are_said():
    """A survivor of deliberate breaks: no test read this line."""
    rng = np.random.default_rng(3)
    lon, lat = sim.uniform_sky(20, rng)
    field = Field(lon, lat, rng.normal(size=(2, 20)), np.ones((2, 20)))
    assert "10 degrees of freedom for 30 coefficients" in fit.fit_field(field, 3).report()
    assert "degrees of freedom for" not in fit.fit_field(field, 1).report()


def test_lost_chi2_is_said():
    """Χ² = χ0² − cᵀb cancels where motions are a million times their errors."""
    rng = np.random.default_rng(4)
    lon, lat = sim.uniform_sky(100, rng)
    motion = sim.spin((1e8, 0, 0))(lon, lat) + rng.normal(size=(2, 100))
    solution = fit.fit_field(Field(lon, lat, motion, np.ones((2, 100))), 1)
    assert "χ² is lost to rounding" in solution.notes[-1]
    assert solution.chi2 >= 0


@pytest.mark.slow
def test_errors_of_powers_without_a_signal():
    """23 to 30 % too large on average."""
    ratio = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        lon, lat = sim.uniform_sky(200, rng)
        solution = fit.fit_field(Field(lon, lat, rng.normal(size=(2, 200)), np.ones((2, 200))), 2)
        for kind in "TS":
            c = solution.covariance[solution.modes.slice_of(kind, 2), solution.modes.slice_of(kind, 2)]
            w = np.array([1, 2, 2, 2, 2])
            ratio.append(solution.power_error(kind, 2) / np.sqrt(2 * np.trace(w[:, None] * c @ (w[:, None] * c))))
    assert np.mean(ratio) < 1.06


def test_no_code_looks_into_a_sentence():
    """What a solution is stands in `error_source`, `includes_floor` and the codes of notes, not in its words."""
    looks = re.compile(r"(errors_from|\bnotes?\b[^\n]{0,20})\.(startswith|partition|find)\(|\bin \w+\.errors_from")
    for path in (each for package in ("fit", "vsh", "sim", "study") for each in (ROOT / package).rglob("*.py")):
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not looks.search(line), f"{path}: {line}"
    assert looks.search('if ", with the floor" in solution.errors_from:')
