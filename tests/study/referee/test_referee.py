"""The referee: published analyses repeated, checks that find what is there and are silent where nothing is."""

import io
import re
from contextlib import redirect_stdout
from html import escape

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, real_catalogue

import sim
from study.commands.referee import main
from study.referee import Quasars, Referee, read_quasars, referee
from study.referee._rows import Value, format_verdict, read_papers
from study.referee._sections import (
    AnalysisInput,
    _check_earlier_release,
    _make_contents_or_reason,
    _repeat_galaxy_motions,
    check_all,
)
from study.referee.page import make_html_page
from vsh import Field
from vsh.tools.digits import format_p_value
from vsh.tools.errors import DegeneracyError, TableError

TRUTH = sim.acceleration((0, -40, -20))


@pytest.fixture(scope="module")
def table():
    return sim.crf4(1, TRUTH, n_five=2000, traps=True, table="all_source_astrometry")


@pytest.fixture(scope="module")
def run(table, tmp_path_factory):
    """The command on a whole catalogue: its answer, what it printed, and its folder."""
    folder = tmp_path_factory.mktemp("referee")
    table.write(folder / "q.fits")
    answers, printed = [], io.StringIO()

    def watched(*arguments, **options):
        answers.append(referee(*arguments, **options))
        return answers[-1]

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setattr("study.referee.referee", watched)
        assert main([str(folder / "q.fits"), "--output", str(folder / "out"), "--format", "none"]) == 0
    return answers[0], printed.getvalue(), folder


@pytest.fixture(scope="module")
def answer(run):
    return run[0]


@pytest.mark.slow
def test_first_line_is_the_acceleration_with_what_sources_share(answer):
    g = answer.headline.acceleration
    away = g.value - (0, -40, -20)
    assert away @ np.linalg.solve(g.covariance, away) < 16
    assert answer.report().startswith(answer.headline.verdict + "\nchecks")
    assert answer.headline.floor is not None


@pytest.mark.slow
def test_spin_has_one_p_value(answer):
    """That of its draws, in the first line as in the section on the frame."""
    assert f"p = {format_p_value(answer.headline.spin.p_value)}" in answer.report().splitlines()[1]


@pytest.mark.slow
def test_every_paper_has_a_section(answer):
    keys = {section.paper.key for section in answer.sections}
    assert keys == set(read_papers()) - {"jaraba2023"}  # beside Darling's
    for section in answer.sections:
        assert bool(section.lacking) != bool(section.rows)
    assert {section.paper.key for section in answer.sections if section.lacking} == {"maloney2026"}


def test_published_numbers_say_where_they_are():
    for paper in read_papers().values():
        assert paper.reference
        assert paper.arxiv.replace(".", "").isdigit()
        for number in paper.numbers.values():
            assert number.where
    klioner = read_papers()["klioner2021"]
    # The amplitude and the direction follow from the components.
    g = np.array([klioner[f"g_{axis}"].value for axis in "xyz"])
    assert np.linalg.norm(g) == pytest.approx(klioner["|g|"].value, abs=0.01)
    assert np.degrees(np.arctan2(g[1], g[0])) % 360 == pytest.approx(klioner["ra"].value, abs=0.1)
    assert np.degrees(np.arcsin(g[2] / np.linalg.norm(g))) == pytest.approx(klioner["dec"].value, abs=0.1)
    assert klioner.citation == "Klioner et al. 2021"
    nguyen = read_papers()["nguyen2026"]
    size = np.linalg.norm([nguyen[f"g_{axis}"].value for axis in "xyz"])
    assert size == pytest.approx(nguyen["|g|"].value, abs=0.12)  # the median of a size is not that of its components


@pytest.mark.slow
def test_checks_are_silent_where_nothing_is_wrong(answer):
    number = sum(np.isfinite(each.p_value) for each in answer.checks)
    assert number >= 14
    worst, p = answer.smallest
    assert p > 0.0027
    assert worst.p_value * number == pytest.approx(p) or p == 1
    assert f"none of {number} internal checks contradicts" in answer.conclusion


@pytest.mark.slow
def test_instrument_is_seen(table):
    """Faint sources turn against bright ones."""
    bent = table.copy()
    faint = bent["phot_g_mean_mag"] > 19.5
    bent["pmra"] = bent["pmra"] + np.where(faint, 0.5 * np.cos(np.radians(bent["dec"])), 0.0)
    quasars = read_quasars(bent)
    main = quasars.recommended
    answer = Referee(quasars, main, [], check_all(quasars, main, 1))
    by_g = next(each for each in answer.checks if each.key == "G")
    assert by_g.p_value < 0.0027
    assert answer.conclusion.startswith("an instrumental effect is detected")
    assert "G" in answer.conclusion


@pytest.mark.slow
def test_sections_without_their_columns_say_which(table):
    bare = table["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error"]
    answer = referee(read_quasars(bare), 1)
    lacking = {section.paper.key: section.lacking for section in answer.sections if section.lacking}
    assert set(lacking) == {"makarov2025", "makarov2026", "tsigkas2025", "maloney2026"}
    assert all("redshift" in words for words in lacking.values())
    frame = next(section for section in answer.sections if section.paper.key == "crf3")
    assert "phot_g_mean_mag" in frame.verdict
    assert "visibility_periods_used" in next(each for each in answer.checks if each.key == "visibility periods").lacking
    assert "not tested" in answer.report(long=True)


@pytest.mark.parametrize("n", [12, *(pytest.param(n, marks=pytest.mark.slow) for n in (60, 150))])
def test_few_sources_say_what_can_be_said(table, n):
    answer = referee(read_quasars(table[:n]), 1)
    assert "µas/yr" in answer.report().splitlines()[0]
    assert any("sources" in each.lacking for each in answer.checks)


def test_too_few_sources(table):
    with pytest.raises(DegeneracyError, match="5 sources do not bear"):
        read_quasars(table[:5])


def test_no_file_of_quasars():
    with pytest.raises(TableError, match="ra"):
        read_quasars(Table({"time": [1.0], "flux": [2.0]}))


def test_columns_follow_their_sources(table):
    """Rows that are left out take their columns along."""
    chosen = table.copy()
    chosen["pmra_error"][::7] = np.nan
    quasars = read_quasars(chosen, on_bad="drop", where="phot_g_mean_mag > 19")
    assert isinstance(quasars, Quasars)
    whole = {int(name): float(value) for name, value in zip(table["source_id"], table["ruwe"], strict=True)}
    assert [whole[int(name)] for name in quasars.field.name] == pytest.approx(quasars.column("RUWE"))
    with pytest.raises(TableError, match="mjd_last"):
        quasars.column("last epoch")


def test_values_in_words():
    assert str(Value(1.234, 0.05)) == "+1.234 ± 0.050"
    assert str(Value(5.05, 0.35, "size")) == "5.05 ± 0.35"
    assert str(Value(0.0231, kind="limit")) == "< 0.0231"
    assert str(Value(1215942.0)) == "1 215 942"
    assert str(Value(float("nan"))) == "–"
    assert format_verdict(0.4, "nothing", "something") == "nothing (p = 0.4000)"
    assert format_verdict(0.02, "nothing", "something").startswith("weak evidence: something")
    assert format_verdict(0.001, "nothing", "something").startswith("something (p = ")


@pytest.mark.slow
def test_figures_and_page_of_the_command(table, tmp_path, capsys):
    table[:600].write(tmp_path / "q.fits")
    page = tmp_path / "r.html"
    assert main([str(tmp_path / "q.fits"), "--output", str(tmp_path / "out"), "--html", str(page)]) == 0
    assert (tmp_path / "out" / "checks.png").stat().st_size > 10_000
    assert page.read_text(encoding="utf-8").count("data:image/png") > 5
    assert capsys.readouterr().out.splitlines()[0][15:60] in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_page(answer):
    page = make_html_page(answer, {}, provenance={})
    assert all(escape(text) in page for _, text in answer.answer.lines)
    assert page.index("The acceleration of the Solar System") < page.index("Is it the instrument?")
    assert 'class="sky"' in page


@pytest.mark.slow
def test_command(run, capsys):
    answer, printed, folder = run
    names = {each.name for each in (folder / "out").iterdir()}
    assert {"report.txt", "numbers.ecsv", "verdicts.ecsv", "checks.ecsv", "solution.ecsv"} <= names
    assert printed.startswith(str(answer.answer) + "\n")
    checks = Table.read(folder / "out" / "checks.ecsv")
    assert len(checks) == len(set(checks["check"]))
    (folder / "broken.fits").write_bytes((folder / "q.fits").read_bytes()[:20_000])
    assert main([str(folder / "broken.fits")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def _rows_of_p_values(page):
    """The rows of a page's table of p-values: what of, with formal errors, with systematic errors."""
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = [each.strip() for each in line.strip("|").split("|")]
        if len(cells) == 3 and all(re.fullmatch(r"\d[\d.e-]*", each) for each in cells[1:]):
            yield cells[0], float(cells[1]), float(cells[2])


@pytest.mark.slow
def test_vlba_sees_no_acceleration():
    """What looks like ten standard errors, and like changes with redshift, is systematic errors."""
    answer = referee(read_quasars(real_catalogue("td2017_vlba_proper_motions.ecsv")), 1)
    page = (ROOT / "docs" / "quoting.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"## How to read the result\n\n((?:    .*\n)+)", page)
    assert block.split() == str(answer.answer).split()
    by_redshift = next(section for section in answer.sections if section.paper.key == "tsigkas2025")
    known = {row.quantity.removeprefix("p, "): (row.theirs.value, row.shared.value) for row in by_redshift.rows}
    known |= {each.question: (each.at_face_value, each.p_value) for each in answer.checks}
    names = {
        "redshift (acceleration)": "one acceleration at all redshifts",
        "redshift (spin)": "one spin at all redshifts",
        "the Galactic plane": "the same near the Galactic plane",
        "(is there a quadrupole?)": "no quadrupole",
        "the ecliptic halves of the sky": "the same in both ecliptic halves of the sky",
    }
    quoted = list(_rows_of_p_values(ROOT / "docs" / "quoting.md"))
    assert len(quoted) == 5
    for name, face, shared in quoted:
        assert known[names.get(name, name)] == pytest.approx((face, shared), rel=0.15, abs=0.006)
    row = next(row for row in by_redshift.rows if "one acceleration" in row.quantity)
    assert row.theirs.value < 0.001
    assert row.shared.value > 0.05
    waves = next(section for section in answer.sections if section.paper.key == "darling2024").rows[1]
    assert waves.theirs.value == pytest.approx(waves.published.value, abs=0.0012)  # 0.0230 here, 0.024 there
    assert next(each for each in answer.checks if each.key == "last epoch").p_value > 0.05


def test_earlier_release(table, tmp_path):
    """Noise that two releases share is told from a change of the acceleration."""
    quasars = read_quasars(table)
    whole, rng = quasars.whole, np.random.default_rng(3)
    true = TRUTH(whole.lon, whole.lat)
    noise = 2 * (np.sqrt(0.5) * (whole.motion - true) + np.sqrt(0.5) * whole.sigma * rng.normal(size=true.shape))
    p = []
    for glide in ((0, 0, 0), (0, 80, 0)):
        motion = true + noise + sim.acceleration(glide)(whole.lon, whole.lat)
        earlier = Field(whole.lon, whole.lat, motion, 2 * whole.sigma, name=whole.name)
        contents = _make_contents_or_reason(lambda earlier=earlier: _check_earlier_release(quasars, earlier, 1))
        assert "whose noise is correlated by" in contents["answer"]
        assert contents["results"]["chain"].correlation[0, 1] == pytest.approx(0.7, abs=0.1)
        p.append(contents["p_value"])
    assert p[0] > 0.01
    assert p[1] < 1e-6
    bare = Field(whole.lon, whole.lat, motion, whole.sigma)
    assert "no names" in _make_contents_or_reason(lambda: _check_earlier_release(quasars, bare, 1))["lacking"]


def test_our_velocity_is_expected_in_the_axes_of_the_catalogue():
    """The microwave background's dipole in ICRS; it once stood there in Galactic axes."""
    field = sim.observe(sim.galaxies(1500, 1), sim.spin((0, 0, 0)), 2, sigma=50.0)
    quasars = Quasars.of(field, {"redshift": field.redshift}, {}, "galaxies")
    made = _repeat_galaxy_motions(AnalysisInput(quasars, None, 1))
    assert [row.quantity.split()[2] for row in made["rows"]] == ["-359", "+77", "-45"]
