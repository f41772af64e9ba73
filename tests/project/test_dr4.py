"""The day of DR4 as its page has it, in small."""

import re
import shlex

import pytest
from conftest import ROOT

from vsh.commands import COMMANDS

PAGE = (ROOT / "docs" / "dr4.md").read_text(encoding="utf-8")
LINES = [line.strip() for line in PAGE.splitlines() if re.match(r" {7,}vsh-", line)]


def run(line, *more):
    from importlib import import_module

    program, *words = shlex.split(line)
    module = COMMANDS[program.removeprefix("vsh-")].module
    return import_module(module).main([*words, *more])


def test_the_page_has_ten_steps():
    assert len(re.findall(r"^\d+\. ", PAGE, re.MULTILINE)) == 10
    assert len(LINES) == 13


@pytest.mark.slow
def test_the_day(tmp_path, monkeypatch, capsys):
    """Every line of the page on tables of 8000 sources, but the archive's, which is not asked."""
    monkeypatch.chdir(tmp_path)
    for line in LINES:
        if line.startswith("vsh-archive"):
            continue
        more = ["--number", "8000"] if line.startswith("vsh-sim") else ["--no-figures"] if "--output" in line else []
        assert run(line, *more) == 0, line
    out = capsys.readouterr().out
    assert out.count("Does the dipole change with class?") == 3
    assert "Does the dipole change with redshift?" in out
    assert "Along each template, by degree" in out
    assert {"answer", "magnitude", "colour", "halves", "bins", "templates", "against3", "gaia", "pairs"} <= {
        each.name for each in tmp_path.iterdir()
    }
