"""`vsh-fit --classes`: magnitudes, conditions, halves of the sky; in memory and in parts."""

import json

import numpy as np
import pytest
from astropy.table import Table

import sim
import vsh
from fit.background import Spectrum
from fit.commands.fit import main
from vsh import Field


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    quasars = sim.quasars(12_000, 3)
    field = sim.observe(quasars, sim.systematics(200 * Spectrum.flat(), 5, lmax=7), 2, sigma=300.0)
    made = field.to_table()
    file = tmp_path_factory.mktemp("classes") / "q.fits"
    made.write(file)
    return file


@pytest.mark.parametrize(
    ("classes", "labels"),
    [
        ("magnitude:18.5,19.5", ("magnitude < 18.5", "18.5 ≤ magnitude < 19.5", "magnitude ≥ 19.5")),
        ("phot_g_mean_mag:19", ("phot_g_mean_mag < 19", "phot_g_mean_mag ≥ 19")),
        ("magnitude < 19; magnitude >= 19", ("magnitude < 19", "magnitude >= 19")),
        ("halves:galactic", ("northern galactic half", "southern galactic half")),
    ],
)
def test_every_way_to_say_classes(classes, labels, path, tmp_path, capsys):
    out = tmp_path / "out"
    words = [str(path), "--lmax", "4", "--format", "none", "--output", str(out), "--classes", classes]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "Does the dipole change with class?" in text
    assert all(label in text for label in labels)
    shared = vsh.read(out / "shared.ecsv")
    assert shared.labels == labels
    assert sum(shared.n_sources) == 12_000
    assert shared.equality() > 0.0027
    assert "higher ones leak" not in text  # halves are summed to three degrees more
    if classes.startswith("halves"):
        assert main([*words, "--workers", "1", "--overwrite"]) == 0
        np.testing.assert_allclose(vsh.read(out / "shared.ecsv").values, shared.values, rtol=1e-6, atol=1e-6)
    capsys.readouterr()


def test_sources_in_no_class_are_counted(path, tmp_path, capsys):
    table = Table.read(path)
    table["phot_g_mean_mag"][:100] = np.nan
    table.write(tmp_path / "some.fits")
    words = [str(tmp_path / "some.fits"), "--lmax", "3", "--classes", "phot_g_mean_mag:19"]
    for more in ([], ["--method", "clip=1.0"], ["--workers", "1"]):
        assert main([*words, *more]) == 0
        assert "100 of 12000 sources are in no class" in capsys.readouterr().out
    assert main([str(path), "--lmax", "3", "--classes", "magnitude:19"]) == 0
    assert "in no class" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("classes", "words"),
    [
        ("magnitude:20,18", "edges that rise"),
        ("magnitude", "COLUMN:EDGE,EDGE"),
        ("halves:equatorial", "unknown frame 'equatorial'"),
        ("magnitude < 19; magnitude < 20", "sources are in more than one of the classes"),
        ("magnitude:3,19", "the class magnitude < 3 is empty"),
        ("nothing:3", "no column 'nothing'"),
    ],
)
def test_messages_name_the_error(classes, words, path, capsys):
    assert main([str(path), "--lmax", "4", "--classes", classes]) == 1
    assert words in capsys.readouterr().err


def test_degrees_are_needed(path, capsys):
    with pytest.raises(SystemExit):
        main([str(path), "--lmax", "2", "--classes", "magnitude:19"])
    assert "tell nothing of systematic errors" in capsys.readouterr().err


def spoilt(tmp_path):
    """Quasars of which one in twenty has motions of fifteen errors."""
    field = sim.observe(sim.quasars(6000, 3), sim.systematics(60 * Spectrum.flat(), 5, lmax=7), 2, sigma=300.0)
    rng = np.random.default_rng(1)
    wrong = np.where(rng.uniform(size=len(field)) < 0.05, 15.0, 0.0)
    table = Field(
        field.lon, field.lat, field.motion + wrong * 300 * rng.standard_normal((2, len(field))), field.sigma,
        magnitude=field.magnitude,
    ).to_table()  # fmt: skip
    table.write(tmp_path / "spoilt.fits")
    return str(tmp_path / "spoilt.fits")


@pytest.mark.slow
def test_robust_weights_serve_classes_and_templates(tmp_path, capsys):
    """Classes and templates were plain least squares, whose errors are 1.8 times as large here; the latter unsaid."""
    words = [spoilt(tmp_path), "--lmax", "4", "--format", "none", "--overwrite", "--output", str(tmp_path / "out")]
    errors = {}
    for name, robust in (("plain", ["--method", "least-squares"]), ("robust", ["--method", "student"])):
        for what in (["--classes", "magnitude:19"], ["--templates", "density"]):
            assert main([*words, *robust, *what]) == 0
            text = capsys.readouterr().out
            shared = vsh.read(tmp_path / "out" / "shared.ecsv")
            errors[name, what[0]] = np.mean(shared.together().acceleration.sigma)
            said = "by the weights of the robust fit" if name == "robust" else "fitted by least squares"
            assert f"classes and templates are {'summed ' if name == 'robust' else ''}{said}" in text
    assert errors["robust", "--classes"] < 0.8 * errors["plain", "--classes"]
    assert errors["robust", "--templates"] < 0.8 * errors["plain", "--templates"]


def test_templates_have_the_floor_however_it_was_asked_for(tmp_path, capsys):
    """With --floor the column of errors with the floor was without it: eight false discoveries in a report."""
    words = [spoilt(tmp_path), "--lmax", "5", "--format", "none", "--overwrite", "--output", str(tmp_path / "out")]
    tables = []
    for more in ([], ["--floor"]):
        assert main([*words, "--method", "least-squares", "--templates", "density,phot_g_mean_mag", *more]) == 0
        capsys.readouterr()
        tables.append(vsh.read(tmp_path / "out" / "cross_powers.ecsv"))
    np.testing.assert_allclose(tables[1].errors_with_floor, tables[0].errors_with_floor, rtol=1e-12)
    np.testing.assert_allclose(tables[1].values, tables[0].values, rtol=1e-12)
    assert np.all(tables[0].errors_with_floor > 1.01 * tables[0].errors)


@pytest.mark.parametrize(
    ("classes", "warned"),
    [("magnitude < 18; magnitude > 19", "are in no class"), ("halves:galactic", "sees too little")],
)
def test_json_and_latex_warn_of_what_the_report_warns(classes, warned, path, capsys):
    """Notes of the sections that stand below the fit were in the terminal's report alone."""
    words = [str(path), "--lmax", "4", "--classes", classes, "--method", "least-squares"]
    assert main([*words, "--long"]) == 0
    assert warned in " ".join(capsys.readouterr().out.split())
    assert main([*words, "--json"]) == 0
    assert any(warned in note for note in json.loads(capsys.readouterr().out)["notes"])
    assert main([*words, "--latex"]) == 0
    comments = [line for line in capsys.readouterr().out.splitlines() if line.startswith("% ")]
    assert ("sees" not in warned) or any(warned in line for line in comments)


def test_the_floor_cannot_be_taken_out_of_the_recommended_fit(path, capsys):
    """`--floor no` changed nothing, without a word."""
    with pytest.raises(SystemExit):
        main([str(path), "--floor", "no"])
    assert "--method student" in capsys.readouterr().err
    assert main([str(path), "--floor", "no", "--method", "student", "--lmax", "1"]) == 0
    assert "systematic floor included" not in capsys.readouterr().out
