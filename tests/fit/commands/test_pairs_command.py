"""vsh-pairs as its users run it."""

import numpy as np
import pytest
from conftest import random_field, real_catalogue

import fit
from fit.commands.pairs import main


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    path = tmp_path_factory.mktemp("pairs") / "sky.fits"
    random_field(600, 1).write(path)
    return str(path)


def test_results(catalogue, tmp_path, capsys):
    folder = tmp_path / "pairs"
    assert main([catalogue, "--bins", "6", "--nside", "1", "--output", str(folder)]) == 0
    results = {"report.txt", "pairs.ecsv", "templates.ecsv", "pairs.png"}
    assert {x.name for x in folder.iterdir()} == results | {"run.toml", "citation.bib", "provenance.json"}
    found = fit.storage.read(folder / "pairs.ecsv")
    assert len(found.theta) == 6
    assert found.theta[-1] == pytest.approx(np.radians(180 * 6 / 7))
    said = capsys.readouterr().out
    assert said.startswith("templates ")
    assert "h70² Ω of gravitational waves" not in said
    assert "h70² Ω of gravitational waves" in (folder / "report.txt").read_text(encoding="utf-8")
    assert main([catalogue, "--output", str(folder)]) == 1
    assert "--overwrite" in capsys.readouterr().err


def test_in_parts_as_whole(catalogue, capsys):
    assert main([catalogue, "--bins", "4", "--nside", "1"]) == 0
    whole = capsys.readouterr().out
    assert main([catalogue, "--bins", "4", "--nside", "1", "--workers", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[3] == whole.splitlines()[3]


def test_usage(catalogue, capsys):
    for bad in (["--up-to", "200"], ["--templates", "strings"], ["--bins", "0"]):
        with pytest.raises(SystemExit):
            main([catalogue, *bad])
    assert main([catalogue, "--templates", "none", "--bins", "3", "--nside", "1", "--up-to", "180"]) == 0
    assert "Templates" not in capsys.readouterr().out
    assert main(["nothing.fits"]) == 1


def test_vlba_table(capsys):
    path = str(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    assert main([path, "--bins", "9"]) == 0
    assert "sources        713; harmonic sums" in capsys.readouterr().out
