"""The result to quote: its four lines, and that every form of a fit carries the same numbers."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field, real_catalogue

import fit
import sim
import vsh
from fit.commands.compare import main as compare
from fit.commands.fit import main
from fit.frames.compare import compare_catalogues
from fit.resample import bootstrap
from fit.results.output import answer_of, format_amplitude, format_direction, is_seen
from fit.results.output._text import words_of
from sim.commands.simulate import main as simulate
from study.referee import read_quasars, referee
from vsh.tools.digits import format_p_value, format_with_error
from vsh.vector import GAIA_EDR3


def observed(seed, acceleration=(0, 0, 0), power=0.0, wrong=1.0, n=1000):
    rng = np.random.default_rng(seed)
    truth = sim.acceleration(acceleration) + sim.random_field(power * (2 * np.arange(1, 6) + 1.0), rng)
    field = sim.observe(sim.quasars(n, 1), truth, rng=rng, sigma=200.0 * wrong)
    return field.with_errors(field.sigma / wrong, field.rho)


def line(result, label):
    lines = dict(result.answer.lines)
    return lines["this fit"] if label == "errors" and "errors" not in lines else lines[label]


@pytest.mark.slow
@pytest.mark.parametrize(("power", "wrong"), [(0.0, 1.5), (200.0, 1.0)])
def test_answer_without_a_signal_is_a_limit(power, wrong):
    answers = [fit.recommended(observed(seed, power=power, wrong=wrong)) for seed in range(20)]
    assert sum(line(each, "acceleration").startswith("not detected") for each in answers) >= 19


def test_answer_detects_a_signal():
    field = observed(1, (0, 0, 60.0), n=2000)
    answer = fit.recommended(field)
    assert re.match(r"\d+\.\d ± \d\.\d µas/yr towards α = ", line(answer, "acceleration"))
    assert "systematic floor included (acceleration ±" in line(answer, "errors")
    # More shared, less sure.
    wide = replace(answer.solution, covariance=answer.solution.covariance + 100.0**2 * np.eye(70))
    assert line(wide, "acceleration").startswith("not detected: < ")


def test_long_report_has_formal_errors_below_those_to_quote():
    result = fit.recommended(observed(1, (0, 0, 60.0), n=2000))
    lines = result.report(long=True).splitlines()
    rows = [line for line in lines if line.startswith("    formal error")]
    formal = result.solution.formal
    for row, vector in zip(rows, (formal.spin, formal.acceleration), strict=True):
        printed = [float(each) for each in re.findall(r"± (\S+)", row)]
        np.testing.assert_allclose(printed, vector.sigma, rtol=0.06)
    assert not np.allclose(formal.acceleration.sigma, result.acceleration.sigma, rtol=0.06)
    assert "formal error " not in result.report()


def test_only_the_recommended_fit_is_one_to_quote():
    field = observed(1, (0, 0, 60.0), n=2000)
    assert "to quote" not in line(fit.recommended(field), "errors")
    for method in set(fit.METHODS) - {"recommended", "jackknife"}:
        label, words = fit.estimate(field, 1, method).answer.lines[0]
        assert label == "this fit"
        assert "to quote: fit.recommended" in words


def test_few_replicates_are_no_evidence():
    """p-values are Hotelling's where replicates gave the errors, and there is no result from too few."""
    field = observed(3)
    for n in (7, 12):
        resampled = bootstrap(field, 1, n, 1, progress=False)
        solution = resampled.resampled_solution
        for name, kind in (("spin", "T"), ("acceleration", "S")):
            assert getattr(resampled, name).p_value == pytest.approx(solution.p_value(kind, 1), rel=1e-9)
            assert f"p = {format_p_value(solution.p_value(kind, 1))}" in line(resampled, name)
    few = bootstrap(field, 1, 3, 1, progress=False)
    assert few.verdict == (
        "acceleration   no result: a covariance with 2 degrees of freedom does not determine the errors of a vector"
    )


def test_errors_that_are_too_small_are_said():
    solution = fit.fit_field(observed(2, (0, 0, 30.0), wrong=1.5), 1)
    assert f"residuals are {solution.quality.factor:.3g} times as large" in line(solution, "errors")
    scaled = fit.estimate(observed(2, (0, 0, 30.0), wrong=1.5), 1, "least-squares")
    assert f"{solution.quality.factor:.3g} times the formal errors" in line(scaled, "errors")
    np.testing.assert_allclose(scaled.spin.sigma, solution.spin.sigma * solution.quality.factor)
    assert "residuals are" not in line(fit.recommended(observed(2, wrong=1.5)), "errors")


def test_how_far_it_is_from_gaia():
    """A limit that excludes 5 µas/yr is remarked on, and what is like it needs no word."""
    field = observed(3, n=3000).with_errors(np.full((2, 3000), 40.0), np.zeros(3000))
    solution = fit.fit_field(field, 1)
    precise = replace(solution, covariance=solution.covariance / 1e4)
    assert re.match(r"this acceleration is \d+\.\d σ from 5\.05 ± 0\.35 µas/yr \(p = ", line(precise, "Gaia EDR3"))
    assert "this may be an instrumental effect" in line(precise, "Gaia EDR3")
    assert "this may be an instrumental effect" not in line(solution, "Gaia EDR3")
    seen = replace(precise, coefficients=replace(precise.coefficients, values=np.r_[0, 0, 0, coefficients_of_gaia()]))
    assert line(seen, "Gaia EDR3").startswith("this acceleration is 0.0 σ")


def coefficients_of_gaia():
    modes = fit.fit_field(observed(1), 1)
    return np.linalg.solve(
        np.array([replace(modes, coefficients=replace(modes.coefficients, values=np.r_[0, 0, 0, row])).acceleration.value
                  for row in np.eye(3)]).T, GAIA_EDR3.value)  # fmt: skip


def test_spin_is_told_as_well():
    field = sim.observe(sim.quasars(2000, 1), sim.spin((0, 50.0, 0)), rng=1, sigma=200.0)
    assert "µas/yr towards" in line(fit.fit_field(field, 3), "spin")
    assert line(fit.fit_field(observed(1), 3), "spin").startswith("not detected: < ")


def test_impossible_units_have_no_answer():
    solution = fit.fit_field(observed(1, wrong=1000.0), 3)
    assert solution.verdict.startswith("acceleration   no result: residuals are ")
    assert "units" in solution.verdict


def test_one_side_of_the_sky_is_cautioned():
    field = observed(1, (0, 0, 300.0), n=4000)
    caution = "one side of the sky has no sources"
    assert caution not in line(fit.fit_field(field, 3), "errors")
    assert caution in line(fit.fit_field(field[field.lat > 0], 3), "errors")
    assert caution in line(fit.fit_field(field[field.lat > 0][:60], 1), "errors")


def test_empty_part_of_the_sky_is_said():
    field = observed(2)
    half = field[field.lon < np.pi]
    noted = [str(each) for each in fit.fit_field(half, 1).notes if "no source within" in str(each)]
    assert len(noted) == 1
    assert 80 < float(noted[0].split("within ")[1].split("°")[0]) < 95
    assert not any("no source within" in str(each) for each in fit.fit_field(field, 1).notes)


def test_positions_have_no_answer():
    solution = fit.fit_field(random_field(100, 1), 1)
    assert answer_of(replace(solution, unit="µas")).lines == ()


SLOW = ("VLBI", "few", "CRF3", "CRF3 whole")


@pytest.fixture(params=["Gaia", *(pytest.param(each, marks=pytest.mark.slow) for each in SLOW)])
def catalogue(request, tmp_path):
    """Errors that are wrong, an acceleration that is detected, too few for a floor, and Gaia's quasars as simulated."""
    if request.param == "VLBI":
        return str(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    if request.param.startswith("CRF3"):
        number = "1614173" if request.param.endswith("whole") else "20000"
        assert simulate(["crf3", "--number", number, "--output", str(tmp_path / "q.fits"), "--quiet"]) == 0
        return str(tmp_path / "q.fits")
    field = observed(1, (0, 0, 60.0), n=2000) if request.param == "Gaia" else observed(4, n=60)
    field.write(tmp_path / "q.fits")
    return str(tmp_path / "q.fits")


def test_every_output_has_the_same_numbers(catalogue, tmp_path, capsys):
    """Python, text, page, LaTeX, JSON and tables: lines, components, limits and p-values."""
    result = fit.recommended(vsh.io.catalogue.read_field(catalogue))
    lines = dict(result.answer.lines)
    out, page = tmp_path / "out", tmp_path / "page.html"
    assert main([catalogue, "--output", str(out), "--html", str(page), "--format", "none"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(result.verdict + "\n")
    assert (out / "report.txt").read_text(encoding="utf-8").startswith(result.verdict + "\n")
    html = page.read_text(encoding="utf-8").replace("&lt;", "<").replace("&#x27;", "'")
    assert all(each in html for each in lines.values())
    assert main([catalogue, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["answer"] == lines
    assert main([catalogue, "--latex"]) == 0
    latex = capsys.readouterr().out
    assert latex.strip() == (out / "table.tex").read_text(encoding="utf-8").strip() == result.solution.latex().strip()
    table = Table.read(out / "vectors.ecsv")
    columns = document["tables"]["vectors"]["columns"]
    for k, name in enumerate(("spin", "acceleration")):
        vector = getattr(result, name)
        for axis, value, sigma in zip("xyz", vector.value, vector.sigma, strict=True):
            for read in (table[k], {head: columns[head]["values"][k] for head in columns}):
                assert (read[axis], read[f"sigma_{axis}"]) == pytest.approx((value, sigma), rel=1e-9)
        formal = getattr(result.solution.formal, name).sigma
        assert [table[f"formal_sigma_{axis}"][k] for axis in "xyz"] == pytest.approx(formal, rel=1e-9)
        assert (formal > 0).all()  # a prior on the higher degrees may make them larger than those quoted
        assert table["p_value"][k] == pytest.approx(vector.p_value, rel=1e-9)
        assert table["limit_95"][k] == pytest.approx(vector.amplitude_limit(), rel=1e-6)
        for cell in fit.output.format_components(vector):
            assert cell in text
            assert cell in html
            assert cell.replace("±", r"\pm") in latex


@pytest.mark.slow
def test_referee_has_the_same_lines(catalogue):
    """Whatever the sources are that it is given."""
    quasars = read_quasars(catalogue)
    if len(quasars.whole) > 100_000:
        pytest.skip("the checks of 1.6 million sources take an hour")
    lines = fit.recommended(quasars.whole).answer.lines
    assert referee(quasars).answer.lines[: len(lines)] == lines


@pytest.mark.slow
def test_comparison_has_the_same_numbers(tmp_path, capsys):
    """ICRF3 and ICRF2: text, page, LaTeX, JSON and tables of their differences."""
    paths = [str(real_catalogue(name)) for name in ("icrf3sx.txt", "icrf2-all.txt")]
    out, page = tmp_path / "out", tmp_path / "page.html"
    assert compare([*paths, "--output", str(out), "--html", str(page), "--format", "none"]) == 0
    text = capsys.readouterr().out
    first, second = (vsh.io.catalogue.read_icrf(path) for path in paths)
    comparison, _ = compare_catalogues(first, second, labels=("icrf3sx", "icrf2-all"))
    lines = dict(comparison.answer.lines)
    assert text.startswith(str(comparison.answer) + "\n")
    html = page.read_text(encoding="utf-8").replace("&lt;", "<")
    assert all(each in html for each in lines.values())
    assert compare([*paths, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["answer"] == lines
    written = Table.read(out / "parameters.ecsv")
    for name, value, sigma in zip(written["ICRF3"], written["value"], written["sigma"], strict=True):
        if name[0] in "RD":
            assert re.search(rf"^  {name} +{re.escape(format_with_error(value, sigma))} ", text, re.MULTILINE)
    best = comparison.best
    for kind, vector in (("R", best.spin), ("D", best.acceleration)):
        chosen = [name.startswith(kind) for name in written["ICRF3"]]
        np.testing.assert_allclose(np.abs(written["value"][chosen]), np.abs(vector.value), rtol=1e-9)
        np.testing.assert_allclose(written["sigma"][chosen], vector.sigma, rtol=1e-9)


def test_rows_of_the_sources(catalogue, tmp_path, capsys):
    """A row each, whose residuals, errors and weights are those of the fit."""
    field = vsh.io.catalogue.read_field(catalogue)
    assert main([catalogue, "--output", str(tmp_path / "out"), "--format", "none"]) == 0
    if len(field) > 100_000:
        assert not list((tmp_path / "out").glob("sources.*"))  # a table as large as the catalogue
        return
    table, result = Table.read(tmp_path / "out" / "sources.ecsv"), fit.recommended(field)
    left = result.solution.residuals(field)
    np.testing.assert_allclose(np.stack([table["residual_east"], table["residual_north"]]), left.motion, rtol=1e-9)
    np.testing.assert_allclose(table["chi2"], left.chi2, rtol=1e-9)
    np.testing.assert_allclose(table["weight"], result.weights.weights, rtol=1e-9)
    assert str(table["residual_east"].unit) == "uas / yr"


def test_a_vector_below_two_of_its_errors_has_no_direction_anywhere():
    """Correlated components: zero is unlikely, and the length is 0.4 of its error."""
    axis = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    covariance = 1e4 * np.outer(axis, axis) + np.eye(3)
    vector = vsh.Vector(40 * axis + 5 * np.array([1.0, -1.0, 0.0]), covariance)
    assert vector.p_value < 1e-4
    assert vector.amplitude < vector.amplitude_error
    assert not is_seen(vector)
    assert format_amplitude(vector).startswith("< ")
    assert format_direction(vector) == "direction not determined"
    words = words_of(vector)
    assert "not zero" in words
    assert "towards" not in words
