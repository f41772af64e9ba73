"""vsh-link as its users run it."""

import json
import re

import numpy as np
import pytest
from astropy.table import Table

import fit
import sim
from fit.commands.link import main
from sim.commands.simulate import main as simulate
from vsh.io.astrometry import read_astrometry, write_astrometry


@pytest.fixture(scope="module")
def stars(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stars")
    data = sim.link(1, 30, spin=(20, -30, 50))
    for each in data.catalogues:
        write_astrometry(data[data.catalogue == each], folder / f"{each}.csv")
    write_astrometry(sim.link(2, 4), folder / "planned.ecsv")
    return folder


def test_two_files(stars, tmp_path, capsys):
    words = [str(stars / "gaia.csv"), str(stars / "vlbi.csv"), "--output", str(tmp_path / "out"), "--format", "png"]
    assert main([*words, "--candidates", str(stars / "planned.ecsv")]) == 0
    text = capsys.readouterr().out
    assert "gaia against vlbi\nsources        30, with" in text
    assert "What to observe next" in text
    solution = fit.storage.read(tmp_path / "out" / "link.ecsv")
    assert np.abs((solution.spin.value - [20, -30, 50]) / solution.spin.sigma).max() < 4
    for name in ("sources.ecsv", "plan.ecsv", "link.png", "plan.png", "report.txt"):
        assert (tmp_path / "out" / name).stat().st_size > 0


def test_json_and_options(stars, capsys):
    words = [str(stars / "gaia.csv"), str(stars / "vlbi.csv"), "--json", "--no-robust", "--steps", "13", "--order", "1"]
    assert main([*words, "--fixed", "vlbi=2010", "--unknowns", "spin"]) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert len(tables["Link"]["columns"]["parameter"]["values"]) == 9
    assert len(tables["Sources"]["columns"]["source"]["values"]) == 30


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--reference", "hip"], "no catalogue is called hip"),
        (["--fixed", "vlbi=now"], "--fixed is NAME=EPOCH"),
        (["--steps", "1"], "cannot separate"),
    ],
)
def test_messages_name_the_error(stars, capsys, words, message):
    assert main([str(stars / "gaia.csv"), str(stars / "vlbi.csv"), *words]) == 1
    assert message in capsys.readouterr().err


def test_one_catalogue_alone(stars, capsys):
    assert main([str(stars / "gaia.csv")]) == 1
    assert "there are gaia" in capsys.readouterr().err


@pytest.mark.slow
def test_command_seeks_and_simulates(tmp_path, capsys):
    path = tmp_path / "stars.ecsv"
    write_astrometry(sim.link(1, 40, jump=(200, 0, 0), quasars=3), path)
    assert len(read_astrometry(path)) == 86
    assert main([str(path), "--seek-step", "8,13", "--output", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "spin detected: (+2" in next(line for line in out.splitlines() if line.startswith("jump at 13"))
    assert "G = 13 is most probable if there is one" in out
    assert {"steps.ecsv", "steps.png", "link.ecsv"} <= {each.name for each in (tmp_path / "out").iterdir()}
    assert main([str(path), "--seek-step", "--steps", "13"]) == 1
    assert "give one of the two" in capsys.readouterr().err


def test_truth_of_a_simulated_link_stands_below(tmp_path, capsys):
    path = str(tmp_path / "stars.ecsv")
    assert simulate(["link", "--number", "60", "--spin", "20,-30,50", "--output", path]) == 0
    capsys.readouterr()
    assert main([path, "--steps", "13"]) == 0
    lines = capsys.readouterr().out.partition("Truth, and how many errors")[2].splitlines()
    heads = {"orientation": "+0.00", "spin": "+20.00", "jump": "+0.00"}
    assert dict(line.split()[:2] for line in lines[1:4]) == heads
    away = [float(each) for line in lines[1:4] for each in re.findall(r"\(([+-][\d.]+)σ\)", line)]
    assert len(away) == 9
    assert np.abs(away).max() < 4


@pytest.mark.parametrize(
    ("words", "expected"), [((), 300.0), (("--epoch", "2020"), 420.0), (("--reference", "gaia"), -300.0)]
)
def test_truth_is_of_the_epoch_and_the_reference(words, expected, tmp_path, capsys):
    more = ["--number", "90", "--spin", "30,-20,10", "--orientation", "300,-200,100"]
    assert simulate(["link", *more, "--output", str(tmp_path / "l.ecsv"), "--quiet"]) == 0
    assert main([str(tmp_path / "l.ecsv"), *words]) == 0
    (line,) = re.findall("^orientation    .*σ\\).*", capsys.readouterr().out, re.MULTILINE)
    assert float(line.split()[1]) == expected
    assert abs(float(line.split("(")[1].split("σ")[0])) < 3.5


def test_hours_and_negative_errors_are_refused(tmp_path, capsys):
    stars = sim.link(1, 30)
    for name in ("gaia", "vlbi"):
        write_astrometry(stars[stars.catalogue == name], tmp_path / f"{name}.csv")
    table = Table.read(tmp_path / "gaia.csv")
    for column, change, words in (
        ("ra", 1 / 15, "is ra in hours?"),
        ("ra_error", -1.0, "30 errors are negative"),
        ("ra_error", 1e-30, "30 errors are below 1e-12 mas"),
    ):
        wrong = table.copy()
        wrong[column] = wrong[column] * change
        wrong.write(tmp_path / "wrong.csv", overwrite=True)
        assert main([str(tmp_path / "wrong.csv"), str(tmp_path / "vlbi.csv")]) == 1
        assert words in capsys.readouterr().err


def test_options_of_other_commands_are_not_proposed(tmp_path, capsys):
    """--units was proposed, and then refused as an option that nobody knows."""
    write_astrometry(sim.link(1, 30), tmp_path / "rows.csv")
    table = Table.read(tmp_path / "rows.csv")
    table["ra"] = table["ra"] / 15
    table.write(tmp_path / "hours.csv")
    assert main([str(tmp_path / "hours.csv")]) == 1
    assert "vsh-link has no --units: change the table, or read it in Python" in capsys.readouterr().err
