"""A section says the same in every form: text, page, notebook, LaTeX."""

import re

import numpy as np
import pytest
from astropy.table import Table

import fit
from vsh import Field
from vsh.figures import page
from vsh.io.sections import Answer, Section, text_of
from vsh.io.tables import table_of

POWER = {
    "degree": [1, 2, 3],
    "power": [5.0, -3.25, 1200.0],
    "sigma_power": [0.51, 0.5, 34.0],
    "p_value": [1e-5, 0.5, np.nan],
}
SECTION = Section(
    "Power by degree",
    [("sources", "713"), ("errors", "robust")],
    table_of(POWER, {}, {"power": "uas2 / yr2", "sigma_power": "uas2 / yr2"}),
    remarks=["Degree 1 contains spin and acceleration."],
    notes=["one note", "one note"],
)


def test_text_pairs_values_with_errors():
    assert str(SECTION).splitlines() == [
        "Power by degree",
        "sources        713",
        "errors         robust",
        "  degree   power [(µas/yr)²]   p value",
        "       1         5.00 ± 0.51   1.0e-05",
        "       2        -3.25 ± 0.50    0.5000",
        "       3           1200 ± 34         –",
        "Degree 1 contains spin and acceleration.",
        "",
        "Notes",
        "  - one note",
    ]


def test_page_has_each_cell_of_the_text():
    html = page.section_panel(SECTION).html
    cells = re.split(r" {2,}", "  ".join(str(SECTION).splitlines()[4:7]).strip())
    assert len(cells) == 9
    for cell in cells:
        assert f">{cell}<" in html
    for words in ("Power by degree", "713", "robust", "Degree 1 contains", "<li>one note</li>"):
        assert words in html


def test_columns_rows_and_forms_choose_what_is_shown():
    shown = Section("Some", (), SECTION.table, ("degree", "p_value"), [2, 0], {"degree": "03d"})
    assert str(shown).splitlines() == ["Some", "  degree   p value", "     003         –", "     001   1.0e-05"]
    assert ">003<" in page.section_panel(shown).html
    assert ">1.0e-05<" in page.section_panel(shown).html
    assert "5.00 ± 0.51" not in page.section_panel(shown).html
    assert len(shown.table) == 3
    assert shown.table.colnames == list(POWER)


def test_angles_are_printed_in_degrees():
    table = Table({"theta": [np.pi / 2]}, units={"theta": "rad"})
    assert str(Section("Angles", (), table)).splitlines()[1:] == ["  theta [deg]", "           90"]


def test_words_stand_left_and_numbers_right():
    table = Table({"name": ["a", "long name"], "value": [1.0, 20.0]})
    assert str(Section("", (), table)).splitlines()[1:] == [
        "  name        value",
        "  a               1",
        "  long name      20",
    ]


def test_sections_are_apart_by_an_empty_line():
    assert text_of([Section("one"), Section("two")]) == "one\n\ntwo\n"


def test_answer_is_printable():
    answer = Answer((("spin", "0\x1b[31m"), ("errors", "robust")))
    assert str(answer) == "spin           0\\x1b[31m\nerrors         robust"
    assert answer.sentence == "spin 0\\x1b[31m; errors robust"


@pytest.mark.parametrize("degree", [1, 3])
def test_result_prints_its_answer_and_its_sections(degree):
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 6.28, 300), np.arcsin(rng.uniform(-1, 1, 300))
    solution = fit.fit_field(Field(lon, lat, 30 * rng.normal(size=(2, 300)), np.full((2, 300), 30.0)), degree)
    for long in (False, True):
        assert solution.report(long=long) == f"{solution.answer}\n\n{text_of(solution.sections(long=long))}"
    html = solution._repr_html_()
    assert all(page.section_panel(section).html in html for section in solution.sections())
