"""The Gaia acceleration paper from one file, on a simulated CRF3 whose truth is known."""

import numpy as np
import pytest
from astropy.table import Table

import sim
from acceleration_paper import FILES, main, read_gaia, run_gaia, subsets, write_gaia
from sim.commands.simulate import main as simulate
from vsh import Vector
from vsh.io.catalogue import read_field, truth_of
from vsh.sky.pixels import pixels_of
from vsh.tools.errors import DegeneracyError, TableError

TRUTH = sim.spin((30.0, -20.0, 10.0)) + sim.acceleration((-10.0, 40.0, 5.0))


@pytest.fixture(scope="module")
def table():
    return sim.crf3(1, TRUTH, n_five=12_000)


def test_table_is_like_the_archives(table):
    assert len(table) == 12_000 + round(12_000 * 398_231 / 1_215_942)
    assert len(np.unique(table["source_id"])) == len(table)
    five = table["astrometric_params_solved"] == 31
    assert set(table["astrometric_params_solved"]) == {31, 95}
    # Klioner et al. (2022), table 1; medians of 12 000 are known to 0.02.
    assert np.median(table["phot_g_mean_mag"][five]) == pytest.approx(19.92, abs=0.05)
    assert np.median(table["phot_g_mean_mag"][~five]) == pytest.approx(20.46, abs=0.05)
    assert np.isnan(table["nu_eff_used_in_astrometry"][~five]).all()
    assert np.isfinite(table["pseudocolour"][~five]).all()
    assert np.median(table["parallax"]) == pytest.approx(-0.017, abs=0.02)
    # The identifier holds the place: HEALPix level 12, nested.
    pixel = pixels_of(np.radians(table["ra"]), np.radians(table["dec"]), 4096, nested=True)
    np.testing.assert_array_equal(table["source_id"] // 2**35, pixel)


def test_its_errors_are_right(table):
    """Pulls of parallax and both motions, their correlations, and the share of sources with wrong errors."""
    field = read_field(table)
    away = field.minus(TRUTH(field.lon, field.lat))
    assert np.median(away.chi2) == pytest.approx(2 * np.log(2), rel=0.03)
    assert (away.chi2 > 25).mean() == pytest.approx(0.002 * np.exp(-25 / 18), abs=0.0005)
    pull = (table["parallax"] + 0.017) / table["parallax_error"]
    assert np.std(pull[np.abs(pull) < 4]) == pytest.approx(1, abs=0.03)
    along = away.motion[0] / away.sigma[0]
    both = np.abs(pull) + np.abs(along) < 6
    seen, quoted = np.mean((pull * along)[both]), np.mean(table["parallax_pmra_corr"][both])
    assert seen == pytest.approx(quoted, abs=0.03)
    assert np.abs(table["pmra_pmdec_corr"]).max() < 1
    assert np.std(table["pmra_pmdec_corr"]) > 0.1


@pytest.mark.slow
def test_rehearsal_of_dr4(tmp_path, capsys):
    """DR4's columns and epoch; its core solutions keep the quasars whose best model is another."""
    best, core = (sim.crf4(1, TRUTH, n_five=4000, table=name) for name in ("gaia_source", "all_source_astrometry"))
    assert core.meta["REFEPOCH"] == 2017.5
    assert set(core["astrometric_params"]) == {31, 95}
    other = ~np.isin(best["astrometric_params"], [31, 95])
    assert 0.001 < other.mean() < 0.01
    np.testing.assert_array_equal(best["pmra"], core["pmra"])
    assert len(read_field(core)) == len(core)
    assert len(read_field(best, on_bad="drop")) == len(best) - other.sum()
    # Twice the time: motions are known 2^1.5 times better, and systematic terms of the instrument as well.
    three = sim.crf3(1, TRUTH, n_five=4000)
    assert 2 < np.median(three["pmra_error"]) / np.median(core["pmra_error"]) < 4
    field = read_field(core)
    assert np.median(field.minus(TRUTH(field.lon, field.lat)).chi2) == pytest.approx(2 * np.log(2), rel=0.05)
    path = tmp_path / "crf4.fits"
    assert simulate(["crf4", "--number", "2000", "--output", str(path)]) == 0
    assert "with another model" in capsys.readouterr().out
    assert "astrometric_params" in Table.read(path).colnames
    with pytest.raises(SystemExit):
        simulate(["crf3", "--table", "all_source_astrometry", "--output", str(path)])


@pytest.mark.slow
def test_tables_and_report_are_written(study, tmp_path):
    (tmp_path / "out").mkdir()
    truth = {"spin": _vector((30, -20, 10)), "acceleration": _vector((-10, 40, 5))}
    text = write_gaia(study, tmp_path / "out", truth=truth)
    assert "The acceleration of the Solar System" in text
    degrees = Table.read(tmp_path / "out" / "degrees.ecsv")
    assert degrees["lmax"].tolist() == [1, 2, 3, 4]
    assert (degrees["chi2_truth_of_6"] < 25).all()
    assert {"published.ecsv", "subsets.ecsv", "powers.ecsv"} <= {path.name for path in (tmp_path / "out").iterdir()}


def _vector(values):
    return Vector(np.array(values, float), np.zeros((3, 3)))


def test_same_seed_gives_the_same_table(table):
    again = sim.crf3(1, TRUTH, n_five=12_000)
    np.testing.assert_array_equal(again["pmra"], table["pmra"])


@pytest.fixture(scope="module")
def study(table):
    return run_gaia(read_gaia(table), max_lmax=4, n_replicates=60, progress=False)


def test_truth_is_within_the_errors_of_every_table(study):
    true = np.array([30.0, -20.0, 10.0, -10.0, 40.0, 5.0])
    rows = [*study.degrees, *study.subsets]
    assert len(rows) > 20
    chi2 = []
    for row in rows:
        found = row.resampled
        value = np.concatenate([found.spin.value, found.acceleration.value])
        for k in (0, 3):
            vector = found.spin if k == 0 else found.acceleration
            away = value[k : k + 3] - true[k : k + 3]
            chi2.append(away @ np.linalg.solve(vector.covariance, away))
    assert np.max(chi2) < 20  # of three numbers: one in 6000
    assert 1.5 < np.median(chi2) < 4  # rows share sources
    assert study.main.name == "degree 3"
    assert study.check.largest < 1e-9
    names = [row.name for row in study.subsets]
    assert {"five parameters", "six parameters", "all", "blue third", "without the Galactic plane"} <= set(names)


def test_both_kinds_of_errors_are_there(study):
    main = study.main
    assert "bootstrap" in main.resampled.errors_from
    assert main.solution.errors_from == "the catalogue"
    ratio = main.resampled.sigma / main.solution.sigma
    assert 0.8 < np.median(ratio) < 1.3


def test_subsets_need_sources(table):
    few = read_gaia(table[:400])
    chosen = subsets(few)
    assert chosen["six parameters"].sum() == 0
    found = run_gaia(few, max_lmax=3, n_replicates=10, progress=False)
    said = {row.name: row.said for row in found.subsets if row.solution is None}
    assert said["six parameters"] == "0 sources, fewer than 100"
    halves = sum(chosen[name].sum() for name in ("northern ICRS half", "southern ICRS half"))
    assert halves == 400


def test_magnitudes_and_colours_share_out_the_sources(table):
    sources = read_gaia(table)
    chosen = subsets(sources)
    five = (~sources.six).sum()
    for names in (("G ≤ 18", "18 < G ≤ 19", "19 < G ≤ 20", "G > 20"), ("red third", "middle third", "blue third")):
        assert sum(chosen[name].sum() for name in names) == five
        assert not np.any(np.sum([chosen[name] for name in names], axis=0) > 1)
    assert np.abs(np.sin(sources.field[chosen["|b| ≥ 30°"]].to_frame("galactic").lat)).min() >= 0.5 - 1e-12


@pytest.mark.slow
def test_command_from_simulation_to_page(tmp_path, capsys):
    path = tmp_path / "crf3.fits"
    assert simulate(["crf3", "--number", "6000", "--spin", "1,2,3", "--output", str(path)]) == 0
    assert "6000 sources with five parameters, 1965 with six" in capsys.readouterr().out
    np.testing.assert_array_equal(truth_of(path)["spin"].value, [1, 2, 3])
    home = tmp_path / "gaia"
    options = [str(path), "--output", str(home), "--lmax", "3", "--n-bootstrap", "10"]
    main(options)
    text = (home / "report.md").read_text(encoding="utf-8")
    assert "| five-parameter sources | 1215942 |  | 6000 |  |" in text
    assert "A simulated catalogue; the truth is g = (-0.236, -3.756, -2.080)" in text
    page = (home / "gaia.html").read_text(encoding="utf-8")
    assert page.count("<img ") == 7  # that of the sky where no script runs, and six figures
    assert "The acceleration of the Solar System" in page
    assert 'src="http' not in page
    degrees = Table.read(home / "degrees.ecsv")
    assert degrees["lmax"].tolist() == [1, 2, 3]
    assert {"g_x", "g_x_formal", "g_x_error", "chi2_truth_of_6"} <= set(degrees.colnames)
    main(options)  # an earlier run is replaced, and nothing else is
    assert {path.name for path in home.iterdir()} == FILES
    (home / "notes.txt").write_text("years of work", encoding="utf-8")
    with pytest.raises(SystemExit):
        main(options)
    assert "files of others (notes.txt)" in capsys.readouterr().err
    assert (home / "notes.txt").exists()
    (tmp_path / "thesis").mkdir()
    with pytest.raises(SystemExit):
        main([str(path), "--output", str(tmp_path / "thesis")])
    assert "holds no earlier run" in capsys.readouterr().err


def test_messages_name_the_error(tmp_path, capsys, table):
    lacking = table.copy()
    lacking.remove_column("pmra_error")
    with pytest.raises(TableError, match="no column 'pmra_error'"):
        read_gaia(lacking)
    with pytest.raises(SystemExit):
        main([str(tmp_path / "no.fits"), "--output", str(tmp_path / "out")])
    assert "no such file" in capsys.readouterr().err
    six = table[table["astrometric_params_solved"] == 95]
    with pytest.raises(DegeneracyError, match="holds no five-parameter solutions"):
        run_gaia(read_gaia(six))
    blind = table[:3000].copy()
    blind.remove_columns(["astrometric_params_solved", "phot_g_mean_mag"])
    notes = read_gaia(blind).field.notes
    assert any(note.startswith("warning: no column astrometric_params_solved") for note in notes)
    assert "no column phot_g_mean_mag: no subsets by it" in notes
    with pytest.raises(SystemExit):
        simulate(["crf3", "--sky", "igql", "--output", "x.fits"])
    assert "--sky does not go with crf3" in capsys.readouterr().err
