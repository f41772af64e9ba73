"""`vsh-agis`: from options to a folder, interrupted and taken up again, and what it refuses."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import fit
from sim.commands.agis import main
from vsh.io import catalogue, tables

SMALL = ["--quasars", "800", "--years", "2", "--seed", "3"]


def run(tmp_path, *more):
    return main([*SMALL, "--output", str(tmp_path / "out"), *more])


@pytest.mark.slow
def test_folder_of_results(tmp_path, capsys):
    assert run(tmp_path, "--vlbi", "100", "--exact", "--acceleration", "5,0,0") == 0
    said = capsys.readouterr().out
    folder = tmp_path / "out"
    assert (folder / "report.txt").read_text(encoding="utf-8") in said
    assert "mission scaled to 800 sources as if they were 500000" in said
    assert "frame rotated: ε₀ =" in said
    assert "acceleration: true/formal" in said
    names = {path.name for path in folder.iterdir()}
    assert names >= {"motions.fits", "sources.fits", "convergence.ecsv", "convergence.png", "errors.png", "correlation.png", "map.png"}  # fmt: skip
    field = catalogue.read_field(folder / "motions.fits")
    assert len(field) == 800
    assert set(catalogue.truth_of(folder / "motions.fits")) >= {"acceleration"}
    assert np.abs(fit.fit_field(field, 1).acceleration.value - [5, 0, 0]).max() < 100
    table = tables.as_table(folder / "sources.fits")
    assert {"error_parallax", "sigma_parallax", "kind", "transits"} <= set(table.colnames)
    assert not (tmp_path / "out.unfinished").exists()
    assert str(tmp_path) not in (folder / "provenance.json").read_text(encoding="utf-8")
    assert json.loads((folder / "provenance.json").read_text(encoding="utf-8"))["command"] == "vsh-agis"
    assert run(tmp_path) == 1  # there already
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.slow
def test_stars_galaxies_and_global_velocity(tmp_path, capsys):
    assert (
        run(
            tmp_path,
            "--stars",
            "400",
            "--galaxies",
            "200",
            "--global",
            "velocity",
            "--exact",
            "--map",
            "--threads",
            "1",
        )
        == 0
    )
    said = capsys.readouterr().out
    assert "800 quasars, 200 galaxies, 400 stars" in said
    assert "global v(1,0)" in said


@pytest.mark.slow
def test_known_attitude_and_nine_ccds(tmp_path, capsys):
    assert run(tmp_path, "--attitude", "10", "--ccds", "9", "--variability", "100", "--method", "simple") == 0
    said = capsys.readouterr().out
    assert "known to 10 µas" in said
    line = next(line for line in said.splitlines() if line.startswith("  quasars "))
    assert all(0.8 < float(x) < 1.5 for x in line.split()[1:])


@pytest.mark.slow
def test_basic_angle_is_solved_for(tmp_path, capsys):
    assert run(tmp_path, "--calibration", "constant to order 1") == 0
    assert "basic angle    solved, constant to order 1" in capsys.readouterr().out
    assert run(tmp_path, "--overwrite") == 0
    assert "basic angle    known" in capsys.readouterr().out


def test_iterations_that_do_not_do_are_said(tmp_path, capsys):
    assert run(tmp_path, "--iterations", "2") == 0
    assert "NOT at rest" in capsys.readouterr().out


def test_plan_makes_nothing(tmp_path, capsys):
    assert main(["--quasars", "500000", "--stars", "2500000", "--plan"]) == 0
    said = capsys.readouterr().out
    assert "million transits" in said
    assert "GiB" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--output DIR, or --plan"),
        (["--output", "x", "--vlbi", "6000"], "6000 quasars cannot be chosen from 5000"),
        (["--output", "x", "--global", "velocity"], "say --galaxies N"),
        (["--output", "x", "--global", "spin"], "acceleration, velocity or a degree"),
        (["--output", "x", "--start", "1"], "two numbers that are not negative"),
        (["--output", "x", "--attitude", "perfect"], "a positive number is expected"),
    ],
)
def test_bad_usage(options, words, capsys):
    with pytest.raises(SystemExit) as caught:
        main(options)
    assert caught.value.code == 2
    assert words in capsys.readouterr().err


def test_memory_is_looked_at_before_the_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sim.agis.passes._scans.free_memory", lambda: 2.0**28)
    assert run(tmp_path) == 1
    assert "the joint solution would need" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_rough_smoothing_is_said_and_too_few_sources(tmp_path, capsys):
    assert run(tmp_path, "--smoothing", "1000") == 0
    assert "smoothing of 1000 µas is a statement on the attitude" in capsys.readouterr().out
    assert main(["--quasars", "5", "--output", str(tmp_path / "few")]) == 1
    assert "5 sources are too few to stand for 500000" in capsys.readouterr().err


def test_too_few_sources_is_one_line(tmp_path, capsys):
    assert run(tmp_path, "--no-scaling") == 1
    said = capsys.readouterr().err
    assert said.startswith("vsh-agis: error: too few sources for the knots")
    assert "Traceback" not in said


@pytest.mark.slow
def test_killed_and_started_again_is_the_same(tmp_path):
    command = [sys.executable, "-m", "vsh", "agis", "--quasars", "5000", "--sky", "igql", "--map"]
    whole = [*command, "--output", str(tmp_path / "whole")]
    subprocess.run(whole, check=True, capture_output=True)
    again = [*command, "--output", str(tmp_path / "again")]
    process = subprocess.Popen(again, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    checkpoint = tmp_path / "again.unfinished" / "checkpoint.npz"
    for _ in range(600):
        if checkpoint.exists() or process.poll() is not None:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert checkpoint.exists()
    subprocess.run(again, check=True, capture_output=True)
    for name in ("motions.fits", "sources.fits", "convergence.ecsv", "report.txt"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
