"""`vsh-fit --value`: parallaxes, and other numbers, in place of motions."""

import json

import healpy
import numpy as np
import pytest
from astropy.table import Table

import sim
from fit.commands.fit import main
from vsh.io.tables import write_table
from vsh.sky.pixels import centres


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory):
    path = tmp_path_factory.mktemp("parallaxes") / "crf3.fits"
    table = sim.crf3(3, n_five=6000, n_six=1000)
    table["zero_point"] = -0.017  # mas, that of the catalogue
    faint = table["phot_g_mean_mag"] > 19.5
    table["bent"] = table["parallax"] + np.where(faint, 0.3, 0.0)
    table["bent_error"] = table["parallax_error"]
    table["word"] = "a"
    table["bent"].unit = table["bent_error"].unit = "mas"
    write_table(table, path)
    return str(path)


def answer_of(path, capsys, *options):
    assert main([path, "--on-bad", "drop", "--json", *options]) == 0
    return json.loads(capsys.readouterr().out)


def mean_of(result):
    meta = result["tables"]["vectors"]["meta"]
    return meta["mean"], meta["mean_error"]


def test_zero_point_of_the_catalogue(catalogue, capsys):
    mean, error = mean_of(answer_of(catalogue, capsys, "--value", "parallax"))
    assert abs(mean + 17) < 3 * error
    assert error < 15
    corrected, _ = mean_of(answer_of(catalogue, capsys, "--value", "parallax - zero_point"))
    assert corrected == pytest.approx(mean + 17, abs=1e-3)
    named, _ = mean_of(answer_of(catalogue, capsys, "--value", "parallax,parallax_error"))
    assert named == pytest.approx(mean)


def test_magnitude_that_changes_the_zero_point(catalogue, capsys):
    same = answer_of(catalogue, capsys, "--value", "parallax", "--classes", "magnitude:19.5")
    assert same["answer"]["classes"].startswith("no change")
    bent = answer_of(catalogue, capsys, "--value", "bent", "--classes", "magnitude:19.5")
    assert bent["answer"]["classes"].startswith("a change")
    table = bent["tables"]["shared"]["columns"]
    faint, bright = table["mean"]["values"][1], table["mean"]["values"][0]
    error = np.hypot(table["mean_error"]["values"][0], table["mean_error"]["values"][1])
    assert abs(faint - bright - 300) < 3 * error


@pytest.mark.parametrize("method", ["recommended", "clip", "excess-noise"])
def test_classes_by_conditions_and_estimators(catalogue, capsys, method):
    options = ["--classes", "phot_g_mean_mag < 19.5; phot_g_mean_mag >= 19.5", "--method", method, "--lmax", "3"]
    found = answer_of(catalogue, capsys, "--value", "parallax", *options)
    assert found["answer"]["classes"].startswith("no change")
    assert found["tables"]["shared"]["columns"]["mean"]["unit"] == "uas"


def test_density_of_the_sources_over_their_selection(catalogue, tmp_path, capsys):
    plain = answer_of(catalogue, capsys, "--value", "density")
    assert "dipole" in plain["answer"]
    healpy.write_map(tmp_path / "selection.fits", (np.abs(centres(16)[1]) > 0.3).astype(float), coord="G", dtype=float)
    masked = answer_of(catalogue, capsys, "--value", f"density,{tmp_path / 'selection.fits'}")
    assert masked["tables"]["vectors"]["meta"]["frame"] == "icrs"
    assert any("sources lie where the selection is zero" in note for note in masked["notes"])


def test_everything_is_written(catalogue, tmp_path, capsys):
    options = ["--value", "parallax", "--on-bad", "drop", "--frame", "ecliptic"]
    assert main([catalogue, *options, "--output", str(tmp_path / "p"), "--html", str(tmp_path / "p.html")]) == 0
    assert "mean  " in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "p").iterdir()}
    assert {"sky.png", "spectrum.png", "solution.ecsv", "floor.ecsv", "table.tex", "vectors.ecsv"} <= names
    assert "Mean and dipole" in (tmp_path / "p" / "table.tex").read_text(encoding="utf-8")
    assert Table.read(tmp_path / "p" / "vectors.ecsv").meta["mean_error"] > 0
    assert "µas" in (tmp_path / "p.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--value", "nothing"], "nothing"),
        (["--value", "parallax > 0"], "not a number"),
        (["--value", "3"], "names no column"),
        (["--value", "parallax - phot_g_mean_mag"], "do not go together"),
        (["--value", "parallax", "--waves"], "--waves"),
        (["--value", "word,ruwe"], "holds text"),
        (["--value", " "], "names no column"),
        (["--value", "parallax", "--columns", "sigma=10"], "sigma="),
    ],
)
def test_what_cannot_be_fitted(catalogue, options, said, capsys):
    try:
        status = main([catalogue, *options, "--on-bad", "drop"])
    except SystemExit as end:
        status = end.code
    assert status in (1, 2)
    assert said in capsys.readouterr().err
