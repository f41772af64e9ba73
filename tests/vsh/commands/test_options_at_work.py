"""Options that stand in no other test: each changes what its help says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table

import sim
from fit.commands import compare, correlate, link, redshift
from vsh.commands import archive
from vsh.io.astrometry import write_astrometry

N = 300


def tables_of(main, words, capsys):
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["tables"]


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two catalogues of one sky: in the second all names are others, and a tenth stands three arcseconds away."""
    folder = tmp_path_factory.mktemp("pair")
    first = sim.observe(sim.quasars(N, 1), sim.spin((0, 0, 0)), 2, sigma=50.0)
    second = sim.observe(sim.quasars(N, 1), sim.spin((0, 0, 0)), 3, sigma=50.0)
    lat = second.lat + np.where(np.arange(N) % 10, 0.1, 3.0) / 206265
    moved = replace(second, lat=lat, name=np.array([f"other {k}" for k in range(N)]))
    first.write(folder / "first.fits")
    moved.write(folder / "second.fits")
    second.write(folder / "same.fits")
    return folder


def test_by_and_radius_match_positions(pair, capsys):
    catalogues = [pair / "first.fits", pair / "second.fits", "--lmax", "1"]
    assert compare.main([*map(str, catalogues)]) == 1  # names match none
    capsys.readouterr()
    for radius, expected in (("1", N - N // 10), ("5", N)):
        assert compare.main([*map(str, catalogues), "--match", radius, "--long"]) == 0
        assert f"{expected} " in capsys.readouterr().out


def test_threshold_leaves_out(pair, capsys):
    catalogues = [pair / "first.fits", pair / "same.fits", "--lmax", "1", "--method"]
    few, many = (tables_of(compare.main, [*catalogues, f"clip={value}"], capsys) for value in ("2", "6"))
    assert len(few["Sources that were left out"]["columns"]["name"]["values"]) > N // 20
    assert "Sources that were left out" not in many


def test_bias_goes_with_the_power_that_is_left_out(pair, capsys):
    biases = []
    for power in ("1", "4"):
        words = [str(pair / "first.fits"), "--lmax", "1", "--leakage", "3", "--power-per-degree", power, "--long"]
        assert correlate.main(words) == 0
        (line,) = [each for each in capsys.readouterr().out.splitlines() if each.startswith("bias")]
        biases.append(float(line.split("omega_x ")[1].split(",")[0]))
    assert biases[1] == pytest.approx(2 * biases[0], rel=0.02)


@pytest.fixture(scope="module")
def stars(tmp_path_factory):
    """The two catalogues of a link."""
    simulated, paths = sim.link(1, 20), [tmp_path_factory.mktemp("link") / f"{name}.csv" for name in ("gaia", "vlbi")]
    for path in paths:
        write_astrometry(simulated[simulated.catalogue == path.stem], path)
    return paths


def test_epoch_and_scale_of_a_link(stars, capsys):
    words = [*stars, "--no-robust"]
    plain, later, wide = (
        tables_of(link.main, [*words, *more], capsys)["Link"]["columns"]
        for more in (["--scale", "1"], ["--scale", "1", "--epoch", "2020"], ["--scale", "3"])
    )
    rows = {name: k for k, name in enumerate(plain["parameter"]["values"])}
    for axis in "xyz":
        orientation, spin = rows[f"epsilon_{axis}"], rows[f"omega_{axis}"]
        shift = later["value"]["values"][orientation] - plain["value"]["values"][orientation]
        assert shift == pytest.approx(4 * plain["value"]["values"][spin], rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(wide["sigma"]["values"], 3 * np.array(plain["sigma"]["values"]), rtol=0.01)


def test_prior_of_a_link(stars, tmp_path, capsys):
    """A spin that is known to a thousandth holds the linked one, at the magnitude that it is known for."""
    Table({"x": [7.0], "y": [8.0], "z": [9.0]} | {f"{axis}_error": [1e-3] for axis in "xyz"}).write(tmp_path / "p.csv")
    words = [*stars, "--no-robust", "--steps", "13"]
    spins = []
    for magnitude in (10.0, 15.0):
        known = Table.read(tmp_path / "p.csv")
        known["magnitude"] = magnitude
        known.write(tmp_path / "p.csv", overwrite=True)
        columns = tables_of(link.main, [*words, "--priors", tmp_path / "p.csv"], capsys)["Link"]["columns"]
        spins.append(dict(zip(columns["parameter"]["values"], columns["value"]["values"], strict=True)))
    for axis, known in zip("xyz", (7, 8, 9), strict=True):
        assert spins[0][f"omega_{axis}"] == pytest.approx(known, abs=0.01)
        assert abs(spins[1][f"omega_{axis}"] - known) > 0.5
        assert spins[1][f"omega_{axis}"] + spins[1][f"jump omega_{axis} at 13"] == pytest.approx(known, abs=0.01)


def test_estimator_of_bins(tmp_path, capsys):
    """Of wrong motions, one in a hundred, clipping leaves nothing; least squares follows them."""
    field = sim.observe(sim.quasars(2000, 1), sim.spin((0, 0, 0)), 2, sigma=50.0)
    motion = field.motion + np.where(np.arange(2000) % 100, 0.0, 5000.0)
    replace(field, motion=motion, redshift_frame="true").write(tmp_path / "z.fits")
    words = [tmp_path / "z.fits", "--bins", "2", "--flows", "no"]
    plain, clipped = (
        tables_of(redshift.main, [*words, *more], capsys)["Bins of redshift"]["columns"]["spin_x"]["values"]
        for more in (["--method", "least-squares"], ["--method", "clip=5"])
    )
    assert np.abs(clipped).max() < 15
    assert np.abs(plain).max() > 15


def test_rows_of_the_archive(monkeypatch, tmp_path):
    calls = []
    monkeypatch.setattr(archive.archive, "query", lambda *_, **keywords: calls.append(keywords) or tmp_path / "q.fits")
    archive.main(["gaia-crf3", "--output", str(tmp_path / "q.fits"), "--max-rows", "7"])
    assert calls[0]["max_rows"] == 7
    monkeypatch.setattr(archive.archive, "fetch_epochs", lambda *_, **keywords: calls.append(keywords) or tmp_path)
    monkeypatch.setattr(archive.archive, "read_ids", lambda _: [1, 2])
    archive.main(["epochs", "--ids", "q.fits", "--output", str(tmp_path / "e"), "--retrieval-type", "EPOCH_PHOTOMETRY"])
    assert calls[1]["retrieval_type"] == "EPOCH_PHOTOMETRY"
