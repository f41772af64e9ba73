"""vsh-waves and vsh-sim epochs as their users run them."""

import json

import numpy as np
import pytest
from astropy.table import Table

import sim
from sim.commands import simulate
from study.commands import waves
from study.commands.waves import main
from vsh.io import tables
from vsh.io.archive import DR4
from vsh.io.epochs import read_observations
from vsh.sky.sphere import angles
from vsh.vector import Vector


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """A coarse map of the stars' response is soon made, and enough."""
    monkeypatch.setattr("study.commands.waves._RESPONSE_NSIDE", 2)


@pytest.fixture(scope="module")
def epochs(tmp_path_factory):
    path = tmp_path_factory.mktemp("epochs") / "e.fits"
    signal = sim.wave_in_time(Vector.from_spherical(1.0, 60.0, -20.0).value, 2.0, 9000.0, 0.0)
    mission = sim.Mission(sim.NominalScanningLaw(years=3.0, dead_time=sim.scanning.DEAD_TIME, rng=3), "DR4", 10.0)
    table = sim.epochs(sim.quasars(30, 1), signal, 2, mission=mission, attitude="perfect", complete=True)
    tables.write_table(table, path)
    return path


def test_file_of_all_columns(epochs):
    table = Table.read(epochs)
    assert len(table.colnames) == 37
    assert table["centroid_pos_al"].shape[1] == 10
    found = read_observations(epochs)
    assert set(found.view) == {1, -1}
    assert len(found.by_transit().time) == len(table)
    assert any("not used by AGIS" in note for note in found.notes)
    # Errors of what was not measured never enter, even without the flag.
    table.remove_column("used_by_agis_al")
    bare = read_observations(table)
    assert any("sky mapper's" in note for note in bare.notes)
    np.testing.assert_allclose(bare.by_transit().position, found.by_transit().position)


@pytest.mark.slow
def test_wave_is_found_in_a_file(epochs, tmp_path, capsys):
    words = [str(epochs), "--frequencies", "2,3", "--lmax", "3", "--nside", "4", "--skies", "50"]
    assert main([*words, "--output", str(tmp_path / "out"), "--json", "--html", str(tmp_path / "w.html")]) == 0
    assert "data:image/png;base64," in (tmp_path / "w.html").read_text(encoding="utf-8")
    told = json.loads(capsys.readouterr().out)
    waves = {name: each["values"] for name, each in told["tables"]["Waves"]["columns"].items()}
    assert waves["frequency"] == [2.0, 3.0]
    assert waves["statistic"][0] > 10 * waves["statistic"][1]
    assert (abs(waves["lon"][0] - 60) < 25, abs(waves["lat"][0] + 20) < 25) == (True, True)
    assert set(told["tables"]) == {"Waves"}
    assert any("spin axis of the scanning law: 0." in note for note in told["notes"])
    names = {each.name for each in (tmp_path / "out").iterdir()}
    assert {"waves.ecsv", "waves.png", "report.txt"} <= names


@pytest.mark.slow
def test_calibration_is_allowed_for(epochs, capsys):
    """It is said in the report, changes limits, and is refused where it has no sense."""
    words = [str(epochs), "--frequencies", "2", "--lmax", "3", "--nside", "4", "--skies", "10", "--json"]
    limits = {}
    for calibration in ("none", "free every 5 days to order 1"):
        assert main([*words, "--calibration", calibration]) == 0
        told = json.loads(capsys.readouterr().out)
        limits[calibration] = told["tables"]["Waves"]["columns"]["limit_median"]["values"][0]
        expected = "no basic angle is calibrated" if calibration == "none" else f"allowed for: {calibration}"
        assert any(expected in note for note in told["notes"])
    # By a wave that the file has, and whose attitude was perfect, limits need not rise.
    assert abs(limits["free every 5 days to order 1"] / limits["none"] - 1) > 0.05
    assert main(words) == 0
    assert any("constant to order 8" in note for note in json.loads(capsys.readouterr().out)["notes"])
    for more in (["--calibration", "every day"], ["--calibration", "constant", "--attitude", "known"]):
        with pytest.raises(SystemExit):
            main([*words, *more])
        assert "--calibration" in capsys.readouterr().err


@pytest.mark.slow
def test_law_from_a_table(epochs, tmp_path, capsys):
    law = sim.NominalScanningLaw(years=3.0)
    time = np.arange(0, 3.0, 1 / 365.25 / 288)
    _, *views = law.attitude(time)
    columns = {"jd_time": (law.start - 2010.0 + time) * 365.25}
    for k, view in enumerate(views, 1):
        columns[f"ra_fov{k}"], columns[f"dec_fov{k}"] = np.degrees(angles(view))
    Table(columns).write(tmp_path / "law.fits")
    words = [str(epochs), "--frequencies", "2", "--lmax", "2", "--nside", "2", "--skies", "5"]
    assert main([*words, "--law", str(tmp_path / "law.fits")]) == 0
    assert "warning" not in capsys.readouterr().out.split("spin axis")[0].splitlines()[-1]
    short = Table(columns)[:9000]
    short.write(tmp_path / "short.fits")
    assert main([*words, "--law", str(tmp_path / "short.fits")]) == 1
    assert "the epochs from" in capsys.readouterr().err
    short.remove_column("ra_fov2")
    short.write(tmp_path / "none.fits")
    assert main([*words, "--law", str(tmp_path / "none.fits")]) == 1
    assert "missing ra_fov2" in capsys.readouterr().err


def test_files_that_lack_something(epochs, tmp_path, capsys):
    table = Table.read(epochs)
    table.remove_columns(["ra0", "dec0"])
    table.write(tmp_path / "without.fits")
    words = ["--frequencies", "2", "--lmax", "2", "--nside", "2", "--skies", "5", "--attitude", "known"]
    assert main([str(tmp_path / "without.fits"), *words]) == 1
    assert "--positions), a table of source_id, ra, dec" in capsys.readouterr().err
    full = Table({"source_id": np.arange(1, 31), "ra": np.zeros(30), "dec": np.zeros(30)})
    known = read_observations(epochs)
    full["ra"], full["dec"] = np.degrees(known.lon), np.degrees(known.lat)
    full.write(tmp_path / "places.fits")
    assert main([str(tmp_path / "without.fits"), *words, "--positions", str(tmp_path / "places.fits")]) == 0
    assert "attitude that is known" in capsys.readouterr().out
    full[:20].write(tmp_path / "some.fits")
    assert main([str(tmp_path / "without.fits"), *words, "--positions", str(tmp_path / "some.fits")]) == 1
    assert "10 of 30 sources of the epochs have no position there" in capsys.readouterr().err
    table["ra0"], table["dec0"] = 0.0, 0.0
    table.remove_column("transit_id")
    table.write(tmp_path / "blind.fits")
    assert main([str(tmp_path / "blind.fits"), *words[:-1], "solved"]) == 1
    assert "field of view" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--wave", "2"], ["--velocity", "planck"], ["--wave", "0,1,1,1,1"]])
def test_options_that_make_no_sense(words, tmp_path, capsys):
    with pytest.raises(SystemExit):
        simulate.main(["epochs", "--output", str(tmp_path / "e.fits"), *words])
    assert words[0] in capsys.readouterr().err


@pytest.mark.slow
def test_law_that_is_far_off_is_said_in_short(epochs, tmp_path, capsys):
    """Angles in radians without a unit: the law was 90° off, which `--long` alone said."""
    table = Table.read(epochs)
    table["scan_pos_angle"] = np.radians(np.asarray(table["scan_pos_angle"]))
    table.write(tmp_path / "radians.fits")
    words = ["--frequencies", "2", "--nside", "2", "--skies", "5"]
    assert main([str(tmp_path / "radians.fits"), *words, "--lmax", "2"]) == 0
    assert "warning: spin axis of the scanning law: " in capsys.readouterr().out


@pytest.mark.parametrize("phase", [2.0, 4.0])
def test_nominal_law_goes_through_the_first_transit(phase):
    """Of one year: what is left is the precession about the Sun's own uneven motion."""
    mission = sim.Mission(sim.NominalScanningLaw(years=1.0, precession_phase=phase), "DR4")
    seen = read_observations(sim.epochs(sim.quasars(40, 1), sim.spin((0, 0, 0)), 1, mission=mission))
    law = waves._fit_nominal_law([seen], DR4.epoch + seen.time.min(), float(np.ptp(seen.time)), ())
    assert np.degrees(waves._compute_median_axis_offset(seen, law)) < 0.5
