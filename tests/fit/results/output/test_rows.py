"""Text, page, notebook and LaTeX print the same numbers, from one place."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from conftest import random_field

import fit
import sim
from fit.results.output import format_amplitude, format_direction, pulls, sections_of, vector_rows, vectors_of
from vsh import Field, Vector
from vsh.io.sections import text_of
from vsh.tools.digits import decimals_of_error
from vsh.tools.errors import ParameterError

TRUTH = {"spin": Vector([3, -4, 5], np.zeros((3, 3))), "acceleration": Vector([0, -4, -2], np.zeros((3, 3)))}


@pytest.fixture(scope="module")
def solution():
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(2000, rng)
    motion = (sim.spin(TRUTH["spin"].value) + sim.acceleration(TRUTH["acceleration"].value))(lon, lat)
    return fit.fit_field(Field(lon, lat, motion + 30 * rng.normal(size=(2, 2000)), np.full((2, 2000), 30.0)), 2)


def numbers(text):
    return re.findall(r"[+-]\d+\.\d+ ± \d+\.\d+", text)


def cells_of(solution):
    return {cell for vector in vectors_of(solution).values() for cell in fit.output.format_components(vector)}


def page_of(solution, folder, **about):
    fit.output.write_html(solution, random_field(30, 1), folder / "page.html", figures={}, overwrite=True, **about)
    return (folder / "page.html").read_text(encoding="utf-8")


def test_all_forms_say_the_same(solution, tmp_path):
    """The page had every pull with the wrong sign; a survivor multiplied it by seven."""
    text = solution.report(truth=TRUTH)
    page = page_of(solution, tmp_path, truth=TRUTH)
    signs = [float(x) for x in re.findall(r"\(([+-]\d+\.\d)σ\)", text)]
    assert [float(x) for x in re.findall(r"\(([+-]\d+\.\d)σ\)", page)] == signs
    expected = np.concatenate([(v.value - TRUTH[n].value) / v.sigma for n, v in vectors_of(solution).items()])
    np.testing.assert_allclose(signs, expected, atol=0.051)
    assert cells_of(solution) <= {*numbers(text)} & {*numbers(page)} & {*numbers(solution._repr_html_())}
    assert all(cell.replace("±", r"\pm") in solution.latex() for cell in cells_of(solution))
    rows = fit.output.power_rows(solution)
    for form in (solution.report(long=True), page):
        assert all(power in form for _, power, *_ in rows)
    for _, _, debiased, error, *_ in rows:  # two digits of each error
        digits = decimals_of_error(float(error))
        assert f"{float(debiased):.{digits}f} ± " in text
        assert f"${float(debiased):.{digits}f}$" in solution.latex(full=True)


@pytest.mark.parametrize(("sigma", "digits"), [(0.19, 2), (0.0999, 3), (1.0, 1), (34.0, 0), (3400.0, 0), (0.0, 3)])
def test_two_digits_of_the_error(sigma, digits):
    assert decimals_of_error([sigma, 10 * sigma]) == digits


def test_latex_in_other_styles(solution):
    """Numbers of siunitx, tables of AASTeX, A&A and MNRAS: one float with a caption that has the answer, and a label."""
    for style in ("booktabs", "siunitx", "aastex", "aa", "mnras"):
        for full in (False, True):
            text = solution.latex(style, full=full)
            assert text.startswith(r"\begin{deluxetable*}" if style == "aastex" else r"\begin{table*}")
            assert f"{solution.n_sources} sources" in text
            assert r"$\chi^2$/dof" in text
            assert text.count("caption{") == text.count(r"\label{") == 1
            assert "Acceleration: " in text
            assert text.count(r"\begin") == text.count(r"\end{")
            assert not set("µ±χ°αδσ") & set(text)
    assert re.search(
        r"\\num\[separate-uncertainty, retain-explicit-plus\]\{[+-]\d+\.\d+ \+- \d+\.\d+\}", solution.latex("siunitx")
    )
    with pytest.raises(ParameterError, match="style"):
        solution.latex("word")


@pytest.mark.parametrize("style", ["booktabs", "siunitx", "aa", "mnras"])
def test_latex_compiles(style, solution, tmp_path):
    if not shutil.which("pdflatex"):
        pytest.skip("there is no pdflatex")
    document = rf"\documentclass{{article}}\usepackage{{booktabs,siunitx}}\begin{{document}}{solution.latex(style, full=True)}\end{{document}}"
    (tmp_path / "t.tex").write_text(document, encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "t.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 0, done.stdout[-800:]


def test_pulls_are_positive_where_the_fit_is_larger():
    vector = Vector([2.0, 0, 0], np.eye(3))
    assert pulls(vector, Vector([1.0, 0, 0], np.zeros((3, 3))))[0] == 1
    (row, truth) = vector_rows({"spin": vector}, {"spin": Vector([1.0, 0, 0], np.zeros((3, 3)))})
    assert truth[:2] == ("  truth", "+1.0 (+1.0σ)")
    assert row[0] == "spin"


def test_low_signal_to_noise_is_said_as_such():
    """Directions ± 127°, ± 349°, ± 57296° at a pole."""
    strong, weak, none = (Vector([0, 0, a], np.eye(3)) for a in (10.0, 2.9, 0.5))
    assert format_amplitude(strong) == "10.0 ± 1.0"
    assert re.fullmatch(r"< \d\.\d+ \(95 %\)", format_amplitude(weak))
    assert re.fullmatch(r"< \d\.\d+ \(95 %\)", format_amplitude(none))
    assert "(± 6°)" in format_direction(Vector([0, 0, 10.0], 0.5 * np.eye(3)))  # at the pole longitude has no error bar
    assert "±" in format_direction(Vector([10.0, 0, 0], np.eye(3)))
    assert "direction not determined" in format_direction(weak)
    assert "direction not determined" in format_direction(none)


def test_cross_check_takes_one_line_unless_it_fails(solution, tmp_path):
    rng = np.random.default_rng(2)
    lon, lat = sim.uniform_sky(100, rng)
    check = fit.cross_check(Field(lon, lat, rng.normal(size=(2, 100)), np.ones((2, 100))))
    assert "agrees to" not in solution.report(check=check)
    text = solution.report(check=check, long=True)
    assert "agrees to" in text
    assert "frame, QR" not in text
    failed = solution.report(check=replace(check, largest=1e-3))
    assert "CROSS-CHECK FAILED" in failed
    assert "frame, QR" in failed
    assert "CROSS-CHECK FAILED" in page_of(solution, tmp_path, check=replace(check, largest=1e-3))


def test_report_is_for_coefficients():
    """Each ended in an AttributeError; ClippedFit has a solution to report."""
    field = random_field(200, 1)
    clipped = fit.clip(field, 1)
    assert text_of(sections_of(clipped)) in clipped.report()
    with pytest.raises(ParameterError, match="not a FrameSolution: use its own"):
        sections_of(fit.solve_frame(field))
    with pytest.raises(ParameterError, match="not a Field"):
        sections_of(field)


def test_large_values_do_not_run_together():
    field = random_field(200, 1)
    text = fit.fit_field(field._derive(motion=field.motion * 1e5), 1).report()
    assert re.search(r"^  spin( +[+-]\d+\.\d+ ± \d+\.\d+){3}  +\d", text, re.M)
