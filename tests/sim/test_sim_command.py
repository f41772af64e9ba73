"""`vsh-sim` from the outside."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, real_catalogue

import fit.commands.fit
import sim
from sim.commands.simulate import main
from vsh.io.catalogue import read_field, truth_of
from vsh.models.cosmology import SUN_IN_LOCAL_GROUP


def test_simulate_and_fit(tmp_path, capsys):
    path = str(tmp_path / "q.fits")
    assert main(f"quasars --number 3000 --sky gums --spin 0,0,30 --seed 2 --output {path}".split()) == 0
    assert "3000 sources" in capsys.readouterr().out
    assert fit.commands.fit.main([path, "--lmax", "1"]) == 0
    text = capsys.readouterr().out
    away = [float(word[1:-2]) for line in text.splitlines() if "truth" in line for word in line.split() if "σ)" in word]
    assert len(away) == 6
    assert max(map(abs, away)) < 4
    options = json.loads(Table.read(path).meta["OPTIONS"])
    assert (options["number"], options["sky"], options["seed"]) == (3000, "gums", 2)


@pytest.mark.parametrize(
    "ending", ["fits", *(pytest.param(ending, marks=pytest.mark.slow) for ending in ("ecsv", "parquet"))]
)
def test_same_seed_same_bytes(tmp_path, ending):
    """With one thread and with four; and another seed is another sky."""
    written = []
    for name, seed, threads in (("a", 5, 1), ("b", 5, 4), ("c", 6, 4)):
        path = tmp_path / f"{name}.{ending}"
        words = f"quasars --number 600 --seed {seed} --threads {threads} --output {path}"  # as it was called
        assert main(words.split()) == 0
        written.append(path.read_bytes())
    assert written[0] == written[1] != written[2]


def test_galaxies_vlbi_and_the_short_way(tmp_path):
    out = tmp_path / "t.ecsv"

    def run(words):
        return main([*words.split(), "--output", str(out)])

    assert run("galaxies --number 500 --velocity 374,-63,53 --flow 750") == 0
    assert np.isfinite(read_field(out).redshift).all()
    assert run("vlbi --number 200 --orientation -10,20,30 --overwrite") == 0
    assert len(read_field(out)) == 200
    meta = Table.read(out).meta
    assert [meta[f"ORIENT_{axis}"] for axis in "XYZ"] == [-10, 20, 30]
    assert truth_of(out) is None  # offsets have neither spin nor acceleration
    assert run("quasars --number 500 --errors expected") == 1  # it is there already
    assert run("quasars --number 500 --errors expected --acceleration -1,2,3 --overwrite") == 0
    assert Table.read(out).meta["ACC_X"] == -1


def test_selection_map(tmp_path):
    selection = str(real_catalogue("selection_function_NSIDE64_G20.0.fits"))
    out = str(tmp_path / "t.fits")
    assert main(["quasars", "--number", "500", "--sky", f"galactic:{selection}", "--output", out]) == 0


@pytest.mark.parametrize(
    "arguments",
    [[], ["stars"], ["quasars"], ["quasars", "--number", "0"], ["quasars", "--spin", "1,2"], ["quasars", "--flow", "-1"],
     ["quasars", "--velocity", "1,2,3"], ["vlbi", "--flow", "linear"],
     ["vlbi", "--errors", "expected"]],
)  # fmt: skip
def test_bad_usage_is_status_2(arguments, tmp_path, capsys):
    output = ["--output", str(tmp_path / "x.fits")] if len(arguments) > 1 else []
    with pytest.raises(SystemExit) as stop:
        main(arguments + output)
    assert stop.value.code == 2
    assert "vsh-sim: error: " in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "message"), [
    (["--output", "x.dat"], "unrecognised format"),
    (["--output", "none/x.fits"], "there is no such folder"),
    (["--sky", "none.fits", "--output", "x.fits"], "cannot be read as a HEALPix map|No such file"),
])  # fmt: skip
def test_bad_data_is_status_1(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["quasars", "--number", "10", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("vsh-sim: error: ")
    assert any(part in error for part in message.split("|"))


@pytest.mark.slow
def test_killed_run_leaves_no_broken_file(tmp_path):
    path = tmp_path / "q.fits"
    for wait in (0.7, 1.5, 2.5):
        run = subprocess.Popen(
            [sys.executable, "-m", "vsh", "sim", "quasars", "--number", "300000", "--output", str(path)],
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        time.sleep(wait)
        run.send_signal(signal.SIGKILL)
        run.wait()
        assert not path.exists()


def test_release_has_its_errors(tmp_path):
    """Found by a newcomer: DR5 had ten years' transits in five."""
    for release in ("DR3", "DR4", "DR5"):
        path = tmp_path / f"{release}.fits"
        assert main(["galaxies", "--number", "300", "--release", release, "--output", str(path), "--quiet"]) == 0
        table = Table.read(path)
        wanted = sim.gaia_errors(np.asarray(table["phot_g_mean_mag"]), release)
        found = 1000 * np.stack([table["pmra_error"], table["pmdec_error"]])
        assert np.median(found / wanted) == pytest.approx(1, abs=0.15)


def test_offsets_are_said_not_to_be_motions(tmp_path, capsys):
    assert main(["vlbi", "--number", "20", "--output", str(tmp_path / "v.fits")]) == 0
    assert "the spin of a fit is their orientation, in µas" in " ".join(capsys.readouterr().out.split())


def test_positions_of_ones_own(tmp_path, capsys):
    """Redshifts and places are those of the table; what has no distance is counted, magnitudes are drawn where missing."""
    rng = np.random.default_rng(1)
    table = Table({"ra": rng.uniform(0, 360, 50), "dec": rng.uniform(-80, 80, 50), "z": rng.uniform(0.003, 0.03, 50)})
    table["z"][:3] = -0.001
    table.write(tmp_path / "mine.ecsv")
    out = tmp_path / "out.fits"
    words = ["galaxies", "--positions", str(tmp_path / "mine.ecsv"), "--velocity", "planck", "--errors", "expected"]
    assert main([*words, "--output", str(out)]) == 0
    said = capsys.readouterr().out
    assert "left out 3 of 50 sources without a usable redshift" in said
    assert "47 of 47 magnitudes drawn" in said
    made = Table.read(out)
    np.testing.assert_allclose(made["ra"], table["ra"][3:])
    np.testing.assert_allclose(made["redshift"], table["z"][3:])
    table["z"].name = "other"
    table.write(tmp_path / "bare.ecsv")
    assert main(["galaxies", "--positions", str(tmp_path / "bare.ecsv"), "--output", str(out), "--overwrite"]) == 1
    assert "has no redshifts" in capsys.readouterr().err
    table["other"] *= 100  # a column and its unit are named as in every command
    table.write(tmp_path / "bare.ecsv", overwrite=True)
    options = ["--columns", "redshift=other", "--units", "other=percent", "--overwrite"]
    assert main(["galaxies", "--positions", str(tmp_path / "bare.ecsv"), *options, "--output", str(out)]) == 0
    np.testing.assert_allclose(Table.read(out)["redshift"], table["other"][3:] / 100)
    for extra in (["--number", "5"], ["--sky", "uniform"]):
        with pytest.raises(SystemExit):
            main([*words, *extra, "--output", str(out)])
        assert "takes the sources of a table" in capsys.readouterr().err


def test_output_of_vsh_sim_is_read(tmp_path, capsys):
    """A few of the nearest galaxies come towards us: none is in the table that no distance follows from."""
    from fit.commands.redshift import main as redshift

    words = ["--number", "3000", "--redshifts", "heliocentric", "--flow", "400", "--velocity", "planck"]
    path = str(tmp_path / "g.fits")
    assert main(["galaxies", *words, "--errors", "expected", "--output", path]) == 0
    assert "without a usable redshift" in capsys.readouterr().out
    assert redshift([path, "--h0", "67.4", "--flows", "no", "--format", "none"]) == 0


def test_observer_takes_part_in_the_flow(tmp_path):
    """Unless our velocity is given, it is that of the flow where we are and the Sun's in the Local Group."""
    path = tmp_path / "g.ecsv"
    command = f"galaxies --number 300 --errors expected --redshifts heliocentric --flow linear --output {path}".split()
    assert main(command) == 0
    truth = truth_of(path)
    rest = truth["velocity"].value - truth["group"].value
    np.testing.assert_allclose(rest, SUN_IN_LOCAL_GROUP.to_frame("icrs").value, atol=1e-9)
    assert 50 < truth["group"].amplitude < 1500
    assert main([*command, "--velocity", "300,10,20", "--overwrite"]) == 0
    assert "group" not in truth_of(path)
