"""`vsh-fit` from the outside."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, real_catalogue
from gaia_table import table

import fit
import sim
import vsh
from fit.commands.fit import main
from fit.results.solution import Solution
from vsh import Field
from vsh.vector import GAIA_EDR3


def test_demo_finds_its_truth(tmp_path, capsys):
    tmp_path = tmp_path / "new" / "demo"
    assert main(["--demo", "--output", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    away = [float(word[1:-2]) for line in text.splitlines() if "truth" in line for word in line.split() if "σ)" in word]
    assert len(away) == 6
    assert max(map(abs, away)) < 3
    # The first page of the documentation explains these lines.
    explained = (ROOT / "docs" / "first_fit.md").read_text(encoding="utf-8")
    quoted = explained.partition("## What the report says")[2].partition("\n## ")[0]
    blocks = re.findall(r"```text\n(.*?)```", quoted, re.DOTALL) + re.findall(r"^    .*$", quoted, re.MULTILINE)
    lines = [" ".join(line.split()) for block in blocks for line in block.splitlines()]
    assert len(lines) > 6
    assert not set(lines) - {" ".join(line.split()) for line in text.splitlines()}
    written = {path.name for path in tmp_path.iterdir()}
    figures = {"sky.png", "spectrum.png", "correlation.png", "residuals.png"}
    tables = {f"{name}.ecsv" for name in ("solution", "correlation", "vectors", "powers", "sources", "floor")}
    assert written == {"report.txt", "table.tex", "run.toml", "citation.bib", "provenance.json"} | tables | figures
    report = (tmp_path / "report.txt").read_text(encoding="utf-8")
    assert text.partition("\n\n")[0] == report.partition("\n\n")[0]
    assert len(report) > len(text)
    assert all(path.stat().st_size > 10_000 for path in tmp_path.glob("*.png"))


@pytest.mark.parametrize(
    "options", ["", "--method least-squares --lmax 1", "--method clip=3 --lmax 1", "--method student --lmax 3"]
)
def test_page_quotes_what_is_printed_of_the_vlba(options, capsys):
    """Steps of docs/quoting.md: the block after each command has lines that it prints."""
    page = (ROOT / "docs" / "quoting.md").read_text(encoding="utf-8")
    assert main([str(real_catalogue("td2017_vlba_proper_motions.ecsv")), *options.split()]) == 0
    printed = capsys.readouterr().out.splitlines()
    quoted = f"`vsh-fit td.ecsv {options}`" if options else "[systematic floor](backgrounds.md), `vsh-fit td.ecsv`"
    _, _, after = page.partition(quoted)
    block = after.partition(":\n\n")[2].partition("\n\n")[0].splitlines()
    assert block
    assert {line.removeprefix("    ") for line in block if "```" not in line} <= set(printed)


def test_signal_added_to_the_vlba_is_recovered():
    """docs/quoting.md: the method would see Gaia's acceleration."""
    page = (ROOT / "docs" / "quoting.md").read_text(encoding="utf-8")
    field = vsh.io.catalogue.read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    added = sim.acceleration(GAIA_EDR3.to_frame("icrs").value)(field.lon, field.lat)
    answer = fit.recommended(replace(field, motion=field.motion + added)).acceleration
    assert f"`fit.recommended` measures {answer.amplitude:.1f} ± {answer.amplitude_error:.1f} µas/yr" in page


def test_solution_can_be_read_and_says_where_it_is_from(tmp_path):
    path = tmp_path / "catalogue.fits"
    bad = table()
    bad["pmra"][7] = np.nan
    bad.write(path)
    words = ["--method", "least-squares", "--lmax", "1", "--on-bad", "drop", "--frame", "galactic"]
    assert main([str(path), *words, "--output", str(tmp_path / "out")]) == 0
    tmp_path = tmp_path / "out"
    solution = Table.read(tmp_path / "solution.ecsv")
    field = vsh.io.catalogue.read_field(path, on_bad="drop").to_frame("galactic")
    np.testing.assert_allclose(solution["value"], fit.fit_field(field, 1).coefficients.values)
    assert list(solution["coefficient"][:3]) == ["t(1,0)", "t(1,1,re)", "t(1,1,im)"]
    assert str(solution["sigma"].unit) == "uas / yr"
    meta = solution.meta
    assert (meta["catalogue"], meta["rows"], meta["rows_used"], meta["rows_refused"]) == ("catalogue.fits", 30, 29, 1)
    assert len(meta["sha256"]) == 64
    assert meta["options"]["frame"] == "galactic"
    assert meta["frame"] == "galactic"
    assert "left out 1 of 30 rows" in meta["notes"][-1]
    assert meta["versions"]["vsh-astrometry"] == vsh.__version__
    correlation = Table.read(tmp_path / "correlation.ecsv")
    np.testing.assert_allclose([correlation[name][i] for i, name in enumerate(correlation["coefficient"])], 1)


def test_columns_and_units(tmp_path):
    path = tmp_path / "other.csv"
    other = table(units=False)
    other.rename_columns(["pmra", "pmdec"], ["mu_a", "mu_d"])
    other.write(path, format="ascii.csv")
    named = ["--columns", "pmra=mu_a,pmdec=mu_d", "--lmax", "1"]
    assert main([str(path), *named]) == 1
    assert main([str(path), *named, "--units", "mu_a=mas/yr,mu_d=mas/yr"]) == 0


@pytest.mark.parametrize("words", [
    "", "a.fits --demo", "a.fits --lmax 0", "a.fits --lmax two", "a.fits --method clip=-1", "a.fits --method clip=x",
    "a.fits --method student=3", "a.fits --method nonsense", "a.fits --frame b1950", "a.fits --columns pmra",
    "a.fits --on-bad ignore", "a.fits --nonsense",
])  # fmt: skip
def test_bad_usage_is_status_2(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    assert stop.value.code == 2
    assert "vsh-fit: error: " in capsys.readouterr().err


def test_bad_data_is_status_1_and_no_traceback(tmp_path, capsys):
    path = tmp_path / "few.fits"
    table()[:5].write(path)
    assert main([str(path), "--method", "least-squares", "--lmax", "4"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("vsh-fit: error: 5 sources cannot separate 48 modes")
    assert "Traceback" not in error
    taken = tmp_path / "taken"
    taken.write_text("a file where the folder should be")
    table().write(tmp_path / "good.fits")
    assert main([str(tmp_path / "good.fits"), "--lmax", "1", "--output", str(taken)]) == 1


def test_real_catalogue(tmp_path, capsys):
    path = real_catalogue("td2017_vlba_proper_motions.ecsv")
    assert main([str(path), "--lmax", "1", "--method", "clip=3", "--output", str(tmp_path)]) == 0
    assert "clipped 68 of 713 sources" in capsys.readouterr().out


def test_more_modes_than_numbers_are_refused_before_any_work(tmp_path, capsys):
    table().write(tmp_path / "c.fits")
    for lmax in ("120", "100000"):
        assert main([str(tmp_path / "c.fits"), "--method", "least-squares", "--lmax", lmax]) == 1
        assert f"modes: lower lmax from {lmax}" in capsys.readouterr().err


def test_careless_spelling(tmp_path, capsys):
    table().write(tmp_path / "c.fits")
    named = ["--columns", "pmra=pmra, pmra_error=pmra_error", "--lmax", "1"]
    assert main([str(tmp_path / "c.fits"), *named]) == 0
    with pytest.raises(SystemExit):
        main([str(tmp_path / "c.fits"), "--output", ""])
    assert "--output: names no folder" in capsys.readouterr().err
    assert main([str(tmp_path / "c.fits"), "--output", str(tmp_path / "c.fits")]) == 1
    assert "c.fits is a file, not a folder" in capsys.readouterr().err


def test_clipped_is_not_refused(tmp_path):
    wild = table()
    wild["pmra"][3] = 1000.0
    wild.write(tmp_path / "c.fits")
    assert main([str(tmp_path / "c.fits"), "--lmax", "1", "--method", "clip=5", "--output", str(tmp_path / "out")]) == 0
    meta = Table.read(tmp_path / "out" / "solution.ecsv").meta
    assert (meta["rows_refused"], meta["rows_used"] + meta["rows_clipped"]) == (0, 30)
    assert meta["rows"] == 30
    assert meta["rows_clipped"] >= 1


@pytest.mark.slow
def test_catalogue_in_parts(tmp_path, capsys):
    """The same report, tables and counts with --workers as with the catalogue read whole; figures are drawn, too."""
    rng = np.random.default_rng(8)
    home = tmp_path / "sky"
    home.mkdir()
    for i in range(3):
        lon, lat = rng.uniform(0, 6, 300), rng.uniform(-1.2, 1.2, 300)
        Field(lon, lat, rng.normal(size=(2, 300)) * 2, np.ones((2, 300))).write(home / f"{i}.fits")
    for name, options in (("whole", []), ("parts", ["--workers", "2"])):
        assert main([str(home), "--lmax", "2", "--method", "clip=2.5", "--output", str(tmp_path / name), *options]) == 0
    one, two = (Solution.read(tmp_path / name / "solution.ecsv") for name in ("whole", "parts"))
    np.testing.assert_allclose(one.values, two.values, atol=1e-10 * one.sigma.max())
    provenance = [json.loads((tmp_path / name / "provenance.json").read_text()) for name in ("whole", "parts")]
    for key in ("rows", "rows_used", "rows_clipped"):
        assert provenance[0][key] == provenance[1][key]
    assert provenance[0]["rows"] == 900 > provenance[0]["rows_used"]
    assert (tmp_path / "parts" / "residuals.png").stat().st_size > 10_000
    assert main([str(home), "--workers", "nowhere.json"]) == 1
    assert "nowhere.json is neither an address" in capsys.readouterr().err
