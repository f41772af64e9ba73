"""One line on whether an acceleration is seen: its errors hold, and it says which they are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fit
import sim
from fit.commands.fit import main
from fit.output import covariance_of_all, verdict
from fit.output._verdict import with_all_errors
from fit.quality import printed_p_value
from fit.resample import bootstrap
from vsh.vector import GAIA_EDR3, Vector


def observed(seed, acceleration=(0, 0, 0), power=0.0, wrong=1.0, n=1000):
    rng = np.random.default_rng(seed)
    truth = sim.acceleration(acceleration) + sim.random_field(power * (2 * np.arange(1, 6) + 1.0), rng)
    field = sim.observe(sim.quasars(n, 1), truth, rng=rng, sigma=200.0 * wrong)
    return field.with_errors(field.sigma / wrong, field.rho)


@pytest.mark.slow
@pytest.mark.parametrize(("power", "wrong"), [(0.0, 1.5), (200.0, 1.0)])
def test_it_sees_nothing_where_nothing_is(power, wrong):
    said = [verdict(fit.fit_field(observed(seed, power=power, wrong=wrong), 3)) for seed in range(20)]
    assert sum("no acceleration is seen" in each for each in said) >= 19
    assert sum("times those quoted" in each for each in said) >= (19 if wrong > 1 else 0)


def test_it_sees_what_is_there():
    solution = fit.fit_field(observed(1, (0, 0, 60.0), n=2000), 3)
    said = verdict(solution)
    assert said.startswith("verdict: an acceleration of ")
    assert "with what sources share (±" in said
    assert verdict(fit.fit_field(observed(1, (0, 0, 60.0), n=2000), 1)).startswith("verdict: perhaps an acceleration")
    # More shared, less sure.
    assert "no acceleration" in verdict(
        replace(solution, floor=SimpleNamespace(acceleration_error=100.0, spin_error=0.0))
    )


def test_few_replicates_are_no_evidence():
    """The verdict has the p-values of the table, Hotelling's where replicates told the errors, and none of too few."""
    field = observed(3)
    for n in (5, 12):
        solution = bootstrap(field, 1, n, 1, progress=False).resampled_solution
        for name, kind in (("spin", "T"), ("acceleration", "S")):
            assert with_all_errors(solution, name)[0].p_value == pytest.approx(solution.p_value(kind, 1), rel=1e-9)
    few = bootstrap(field, 1, 3, 1, progress=False).resampled_solution
    assert verdict(few) == "verdict: none; 3 replicates are too few for the errors of a vector"
    assert "direction not determined" in few.report()
    # A floor that is known beside them makes its part of the errors surer.
    sure = replace(solution, floor=SimpleNamespace(acceleration_error=300.0, spin_error=0.0))
    assert with_all_errors(sure)[0].dof > 10 * solution.covariance_dof


def test_errors_that_are_wrong_are_multiplied():
    solution = fit.fit_field(observed(2, (0, 0, 30.0), wrong=1.5), 1)
    a = solution.acceleration
    p = Vector(a.value, a.covariance * solution.quality.factor**2).p_value
    assert f"p = {printed_p_value(p)};" in verdict(solution)


def test_recommended(tmp_path, capsys):
    observed(1, (0, 0, 60.0), n=2000).write(tmp_path / "q.fits")
    assert main([str(tmp_path / "q.fits"), "--recommended", "--no-figures"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("verdict: an acceleration")
    assert "robust fit" in first
    assert "with what sources share" in first
    assert main([str(tmp_path / "q.fits"), "--lmax", "1", "--no-figures"]) == 0
    assert "verdict: perhaps" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([str(tmp_path / "q.fits"), "--recommended", "--clip", "3"])
    assert "leave out --clip" in capsys.readouterr().err


def test_what_gaia_has_is_beside_it():
    """A limit that excludes 5 µas/yr is no peaceful one, and what is like it needs no word."""
    solution = fit.fit_field(observed(3, n=3000).with_errors(np.full((2, 3000), 40.0), np.zeros(3000)), 1)
    precise = replace(solution, covariance=solution.covariance / 1e4)
    assert "disagrees with Gaia EDR3's 5.05 ± 0.35 (p = " in precise.verdict
    assert "is it the instrument?" in precise.verdict
    assert "allows Gaia EDR3's" in solution.verdict
    seen = replace(precise, coefficients=replace(precise.coefficients, values=np.r_[0, 0, 0, coefficients_of_gaia()]))
    assert "agrees with Gaia EDR3's" in seen.verdict
    assert "disagrees" not in seen.verdict
    assert precise.verdict == verdict(precise)


def test_a_spin_is_told_as_well():
    solution = fit.fit_field(sim.observe(sim.quasars(2000, 1), sim.spin((0, 50.0, 0)), rng=1, sigma=200.0), 3)
    assert "; a spin of " in solution.verdict
    assert "; no spin, below " in fit.fit_field(observed(1), 3).verdict


def test_nothing_is_said_by_units_that_cannot_be():
    solution = fit.fit_field(observed(1, wrong=1000.0), 3)
    assert solution.verdict.startswith("verdict: none; residuals are ")
    assert "units" in solution.verdict


def test_one_side_of_the_sky_is_perhaps():
    field = observed(1, (0, 0, 300.0), n=4000)
    assert fit.fit_field(field, 3).verdict.startswith("verdict: an acceleration")
    assert fit.fit_field(field[field.lat > 0], 3).verdict.startswith("verdict: perhaps an acceleration")
    assert "one side of the sky" in fit.fit_field(field[field.lat > 0], 3).verdict
    assert "one side of the sky" not in fit.fit_field(field[field.lat > 0], 1).verdict


def coefficients_of_gaia():
    modes = fit.fit_field(observed(1), 1, floor=False)
    return np.linalg.solve(
        np.array([replace(modes, coefficients=replace(modes.coefficients, values=np.r_[0, 0, 0, row])).acceleration.value
                  for row in np.eye(3)]).T, GAIA_EDR3.value)  # fmt: skip


def test_an_empty_part_of_the_sky_is_said():
    field = observed(2)
    half = field[field.lon < np.pi]
    noted = [str(each) for each in fit.fit_field(half, 1).notes if "no source within" in str(each)]
    assert len(noted) == 1
    assert 80 < float(noted[0].split("within ")[1].split("°")[0]) < 95
    assert not any("no source within" in str(each) for each in fit.fit_field(field, 1).notes)


def test_cards_have_the_errors_of_the_verdict(tmp_path, capsys):
    observed(2, wrong=3.0).write(tmp_path / "q.fits")
    page = tmp_path / "q.html"
    assert main([str(tmp_path / "q.fits"), "--no-figures", "--html", str(page)]) == 0
    limit = capsys.readouterr().out.split("below ")[1].split(" ")[0]
    assert f"&lt; {limit} (95 %) µas/yr" in page.read_text(encoding="utf-8")


def test_figures_have_the_errors_of_the_verdict():
    """The vectors of the covariance that figures use are those with every error that is known of."""
    solution = fit.fit_field(observed(4, power=2000.0, wrong=1.5), 3)
    assert solution.quality.contradicted
    drawn = replace(solution, covariance=covariance_of_all(solution))
    for name in ("spin", "acceleration"):
        whole = with_all_errors(solution, name)[0]
        np.testing.assert_allclose(getattr(drawn, name).covariance, whole.covariance, rtol=1e-10)
