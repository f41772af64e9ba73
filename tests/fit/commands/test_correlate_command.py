import numpy as np
import pytest
from astropy.table import Table

import sim
from fit.commands.correlate import main
from vsh.io.catalogue import read_sources


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp("catalogues")
    for sky in ("gums", "igql"):
        field = sim.observe(sim.quasars(2000, 1, sky), sim.spin((0, 0, 0)), rng=2, release="DR5")
        field.write(folder / f"{sky}.fits")
    return [str(folder / "gums.fits"), str(folder / "igql.fits")]


@pytest.mark.slow
def test_two_catalogues(paths, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["--influence", "omega_y,a_x", "--influence", "a_z", "--leakage", "4", "--frame", "galactic"]
    assert main([*paths, *arguments, "--long", "--output", str(out)]) == 0
    text = capsys.readouterr().out
    for words in ("above diagonal  gums", "below diagonal  igql", "The independent solver of degree 1 gives the same", "the sky around",
                  "igql: bias of the fit by degrees 2 to 4", "of the information of uniformly distributed sources"):  # fmt: skip
        assert words in text
    names = {each.name for each in out.iterdir()}
    assert {"correlation.png", "correlation.ecsv", "report.txt", "leakage_gums.png", "leakage_igql.ecsv"} <= names
    assert "influence_igql_omega_y_a_x.fits" in names
    table = Table.read(out / "correlation.ecsv")
    assert table.meta["lower"] == "igql"
    assert table.meta["catalogue"] == ["gums.fits", "igql.fits"]
    values = Table.read(out / "influence_igql_omega_y_a_x.fits")
    assert len(values) == 3072
    assert values.meta["ORDERING"] == "RING"
    assert values.meta["FRAME"] == "galactic"


def test_coefficients(paths, capsys):
    assert main([paths[1], "--lmax", "2", "--influence", "t(1,0),s(2,1,re)"]) == 0
    text = capsys.readouterr().out
    assert "correlation of t(1,0) and s(2,1,re)" in text


def test_positions_alone_will_do(tmp_path, capsys):
    quasars = sim.quasars(500, 1)
    path = tmp_path / "positions.csv"
    Table({"RA": np.degrees(quasars.lon), "DE": np.degrees(quasars.lat)}).write(path)
    assert main([str(path), "--columns", "ra=RA,dec=DE", "--units", "RA=deg,DE=deg"]) == 0
    assert "no errors in the table: all sources weigh the same" in capsys.readouterr().out
    assert main([str(path), "--columns", "ra=RA,dec=DE", "--units", "RA=deg,DE=deg", "--columns", "sigma=50"]) == 0
    assert "errors of 50 µas/yr for every source (as asked)" in capsys.readouterr().out
    assert main([str(path)]) == 0
    assert "no unit in the table, so taken in deg: RA, DE" in capsys.readouterr().out
    Table({"x": [1.0], "y": [2.0]}).write(tmp_path / "xy.csv")
    assert main([str(tmp_path / "xy.csv")]) == 1
    assert "no column 'ra'" in capsys.readouterr().err
    field = read_sources(path, {"ra": "RA", "dec": "DE"}, {"RA": "deg", "DE": "deg"})
    assert (field.motion == 0).all()
    np.testing.assert_allclose(field.sigma, 1000)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--leakage", "1"], "a whole number of at least 2"),
        (["--leakage", "2", "--lmax", "3"], "more than --lmax 3"),
        (["--influence", "a_x,a_x"], "one or two different names"),
        (["--influence", "a_x,a_y,a_z"], "one or two different names"),
        (["--nside", "3"], "in Python: influence_map(nside=)"),
    ],
)
def test_bad_usage_ends_with_2(paths, arguments, words, capsys):
    with pytest.raises(SystemExit) as status:
        main([paths[0], *arguments])
    assert status.value.code == 2
    assert words in capsys.readouterr().err


def test_half_of_the_errors_is_a_slip(paths, tmp_path, capsys):
    table = Table.read(paths[0])
    table.rename_column("pmdec_error", "epmdec")
    table.write(tmp_path / "slip.fits")
    assert main([str(tmp_path / "slip.fits")]) == 1
    assert "no column 'pmdec_error'" in capsys.readouterr().err
    assert main([str(tmp_path / "slip.fits"), "--columns", "sigma=100"]) == 0


def test_bad_data_end_with_1(paths, tmp_path, capsys):
    assert main([paths[0], "--influence", "a_x,t(4,0)"]) == 1
    assert "no parameter is called t(4,0); there are omega_x" in capsys.readouterr().err
    assert main([str(tmp_path / "none.fits")]) == 1
    broken = Table.read(paths[0])
    broken["dec"][:3] = np.nan
    broken.write(tmp_path / "broken.fits")
    assert main([str(tmp_path / "broken.fits")]) == 1
    assert "3 of 2000 rows cannot be used: position not finite: 3" in capsys.readouterr().err
    assert main([str(tmp_path / "broken.fits"), "--on-bad", "drop"]) == 0
