"""What a command prints: for people, for programs, for a paper, nothing."""

import io
import json
import logging
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT

import fit
import sim
import vsh.__main__ as commands
from fit.commands import compare, correlate, pairs, redshift
from fit.commands.fit import main
from sim.commands import simulate
from study.commands import forecast
from vsh.commands import parsing
from vsh.io import catalogue


@pytest.fixture(scope="module")
def galaxies(tmp_path_factory):
    path = tmp_path_factory.mktemp("told") / "g.fits"
    words = f"galaxies --number 600 --errors expected --velocity planck --output {path} --quiet"
    assert simulate.main(words.split()) == 0
    return str(path)


def test_json_is_the_result(capsys):
    assert main(["--demo", "--method", "least-squares", "--lmax", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    solution = fit.fit_field(catalogue.read_field(str(ROOT / "fit" / "demo.fits")), 2)
    assert told["command"] == "vsh-fit"
    assert told["options"] == {"demo": True, "method": "least-squares", "lmax": 2}
    vectors = told["tables"]["vectors"]
    assert vectors["meta"]["n_sources"] == 4000
    columns = {name: column["values"] for name, column in vectors["columns"].items()}
    k = columns["name"].index("acceleration")
    found = solution.acceleration
    assert [columns[name][k] for name in "xyz"] == found.value.tolist()
    assert [columns[f"sigma_{name}"][k] for name in "xyz"] == found.sigma.tolist()
    assert columns["cov_xz"][k] == found.covariance[0, 2]
    assert columns["p_value"][k] == pytest.approx(found.p_value)
    assert columns["limit_95"][k] == found.amplitude_limit(0.95)
    assert columns["debiased_amplitude"][k] == found.debiased_amplitude
    assert vectors["columns"]["x"]["unit"] == "uas / yr"
    powers = {name: column["values"] for name, column in told["tables"]["powers"]["columns"].items()}
    assert list(zip(powers["kind"], powers["l"], strict=True)) == [("T", 1), ("T", 2), ("S", 1), ("S", 2)]
    np.testing.assert_array_equal(told["tables"]["coefficients"]["columns"]["value"]["values"], solution.values)


def test_warnings_are_in_the_json(tmp_path, capsys):
    """Found by a newcomer: errors that χ² contradicts, chances that forget how few replicates there were."""
    field = sim.observe(sim.quasars(300, 1), sim.spin((0, 0, 5)), 2, sigma=10.0)
    field.with_errors(field.sigma / 3).write(tmp_path / "f.fits")
    assert main([str(tmp_path / "f.fits"), "--method", "least-squares", "--lmax", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert "times the formal errors" in told["answer"]["this fit"]
    assert main([str(tmp_path / "f.fits"), "--method", "bootstrap=12", "--lmax", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["tables"]
    vectors, powers = (told[name]["columns"] for name in ("vectors", "powers"))
    np.testing.assert_allclose(vectors["p_value"]["values"], powers["p_value"]["values"], rtol=1e-9)
    assert powers["power"]["unit"] == "uas2 / yr2"


COMMANDS = {
    "redshift": (redshift.main, ["--h0", "67.4", "--velocity", "planck", "--bins", "2"], {"Bins of redshift", "Do the bins differ?", "Our velocity", "The Hubble constant"}),
    "correlate": (correlate.main, ["--leakage", "2"], {"Correlations", "Leakage, g"}),
    "pairs": (pairs.main, ["--bins", "4", "--nside", "1"], {"Correlation by angle", "Templates"}),
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("how", ["--json", "--latex", "--quiet"])
def test_every_command_tells(command, how, galaxies, tmp_path, capsys):
    run, words, headings = COMMANDS[command]
    assert run([galaxies, *words, how, "--output", str(tmp_path / "out"), "--format", "none"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    if how == "--json":
        told = json.loads(out)
        assert set(told["tables"]) == headings
        assert told["written"] == [str(tmp_path / "out")]
    elif how == "--latex":
        parts = len(re.findall(r", part [2-9] of", out))  # of a table that is wider than a page
        assert out.count(r"\caption{") - parts == len(headings)
        assert out.count(r"\toprule") == out.count(r"\bottomrule") == len(headings) + parts
        rows = [line for line in out.splitlines() if line.endswith(r"\\")]
        assert all(row.count("&") == rows[0].count("&") for row in rows[:3])
    else:
        assert out == ""
    assert (tmp_path / "out" / "report.txt").stat().st_size > 200


def test_others(galaxies, tmp_path, capsys):
    for run, words, heading in (
        (compare.main, f"{galaxies} {galaxies} --lmax 1", "Coefficients"),
        (forecast.main, "--survey mine=3000,3.0 --only VLBI --no-flows", "Expected errors"),
    ):
        assert run([*words.split(), "--json"]) == 0
        assert heading in json.loads(capsys.readouterr().out)["tables"]
    words = f"quasars --number 9 --errors expected --output {tmp_path / 's.fits'} --spin 1,2,3 --json"
    assert simulate.main(words.split()) == 0
    told = json.loads(capsys.readouterr().out)
    truth = {name: column["values"] for name, column in told["tables"]["truth"]["columns"].items()}
    assert truth["value"][truth["name"].index("SPIN_Y")] == 2
    assert told["written"] == [str(tmp_path / "s.fits")]


def test_error_stays_an_error(capsys):
    assert main(["nowhere.fits", "--json"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "vsh-fit: error: nowhere.fits: no such file\n"


def test_one_way_of_telling_at_a_time(capsys):
    with pytest.raises(SystemExit):
        main(["--demo", "--json", "--quiet"])
    assert "not allowed with" in capsys.readouterr().err


def test_log(tmp_path, capsys):
    log = tmp_path / "run.log"
    before = {name: logging.getLogger(name).level for name in ("vsh", "fit")}
    assert main(["--demo", "--method", "least-squares", "--lmax", "1", "--log", str(log)]) == 0
    assert main(["nowhere.fits", "--log", str(log)]) == 1
    lines = log.read_text(encoding="utf-8").splitlines()
    begun = "vsh-fit --demo --method least-squares --lmax 1"
    for words in (begun, "demo.fits: Field: 4000 sources", "normal equations: ", "solved: ", "vsh-fit is done"):
        assert any(words in line for line in lines), words
    assert "ERROR" in lines[-1]
    assert lines[-1].endswith("TableError: nowhere.fits: no such file")
    assert {name: logging.getLogger(name).level for name in before} == before
    assert main(["--demo", "--log", str(tmp_path / "no" / "x.log")]) == 1
    assert "no/x.log: No such file or directory" in capsys.readouterr().err


def test_without_a_log_nobody_hears_anything(caplog):
    with caplog.at_level(logging.INFO):
        field = sim.observe(sim.quasars(100, 1), sim.spin((1, 2, 3)), 2, sigma=10.0)
        fit.fit_field(field, 1)
    told = [record.getMessage() for record in caplog.records]
    assert [text.split(":")[0] for text in told] == ["observed", "normal equations", "solved"]


@pytest.mark.parametrize("command", commands.COMMANDS)
def test_citations(command, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main([command, "--citation"])
    assert not end.value.code
    out = capsys.readouterr().out
    assert out.startswith("@software{vsh_astrometry,")
    assert out.count("{") == out.count("}")
    assert "VERSION" not in out
    # Every entry has a title, and is there once.
    assert out.count("\n@") + 1 == out.count("  title") == len(parsing.collect_citation_keys(f"vsh-{command}", {}))


def test_citations_of_what_is_asked_for():
    plain = parsing.collect_citation_keys("vsh-redshift", {})
    assert "foremanmackey2013" not in plain
    assert "foremanmackey2013" in parsing.collect_citation_keys("vsh-redshift", {"posterior": True})
    assert "hunter2007" in parsing.collect_citation_keys("vsh-fit", {"output": "x"})
    assert "hunter2007" not in parsing.collect_citation_keys("vsh-fit", {"output": "x", "format": "none"})
    assert "planck2020overview" in parsing.collect_citation_keys("vsh-sim", {"velocity": "planck"})
    assert "gorski2005" in parsing.collect_citation_keys(
        "vsh-pairs", {}
    )  # what the command itself uses, whatever is asked for


class Piped:
    """Standard input with bytes in it."""

    def __init__(self, content, terminal=False):
        self.buffer, self.terminal = io.BytesIO(content), terminal

    def isatty(self):
        return self.terminal


def test_standard_input(galaxies, tmp_path, monkeypatch, capsys):
    assert main([galaxies, "--lmax", "1", "--output", str(tmp_path / "a"), "--format", "none"]) == 0
    capsys.readouterr()
    content = Path(galaxies).read_bytes()
    monkeypatch.setattr(sys, "stdin", Piped(content))
    assert main(["-", "--lmax", "1", "--output", str(tmp_path / "b"), "--format", "none"]) == 0
    out = capsys.readouterr().out
    assert "standard input: " in out
    one, two = (Table.read(tmp_path / name / "solution.ecsv") for name in "ab")
    np.testing.assert_array_equal(one["value"], two["value"])
    assert two.meta["sha256"] == one.meta["sha256"]
    assert two.meta["catalogue"] == "standard input"
    for stdin, words in (
        (Piped(b""), "standard input is empty"),
        (Piped(b"", terminal=True), "nothing comes in"),
        (Piped(b"hel\0lo\n"), "standard input: unrecognised format"),
    ):
        monkeypatch.setattr(sys, "stdin", stdin)
        assert main(["-"]) == 1
        assert words in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", Piped(content))
    assert compare.main(["-", "-"]) == 1
    assert "standard input holds one catalogue" in capsys.readouterr().err
