"""Columns of any meaning, at the rows that a field keeps."""

from contextlib import nullcontext

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

from vsh.io.catalogue import read_columns, read_field, stream_columns
from vsh.tools.errors import FieldError, TableError


@pytest.fixture
def table():
    rng = np.random.default_rng(1)
    made = Table({name: rng.uniform(1, 80, 50) for name in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")})
    made["source_id"] = np.arange(50) + 10**15
    made["mjd"] = 50_000.0 + np.arange(50)
    made["periods"] = MaskedColumn(np.arange(50), mask=np.arange(50) % 10 == 0)
    made["sort"] = np.array(["a", "b"] * 25)
    return made


def test_rows_are_those_of_the_field(table):
    table["pmra"][[3, 7]] = np.nan
    chosen = {"where": "mjd > 50010", "on_bad": "drop"}
    columns = read_columns(table, ["mjd", "periods"], **chosen)
    field = read_field(table, **chosen)
    np.testing.assert_array_equal(columns["mjd"], np.asarray(field.name, int) - 10**15 + 50_000)
    assert np.isnan(columns["periods"]).sum() == 3  # masked
    chosen["where"] = None
    assert len(read_columns(table, ["mjd"], **chosen)["mjd"]) == 48


def test_blocks_are_the_whole(table):
    """Rows that are missing, not selected, or a whole block of them, and numbers beside the fields."""
    table["pmra"][[3, 7]] = np.nan
    table["dec"][20:30] = 99.0  # a whole block that cannot be used
    chosen = {"where": "mjd > 50002", "on_bad": "drop"}
    blocks = list(stream_columns(table, ["periods"], 10, **chosen))
    assert [len(field) for field, _ in blocks] == [5, 10, 10, 10]  # of 3 … 9 two are missing
    whole = read_columns(table, ["periods"], **chosen)["periods"]
    np.testing.assert_array_equal(np.concatenate([columns["periods"] for _, columns in blocks]), whole)
    field = read_field(table, **chosen)
    np.testing.assert_array_equal(np.concatenate([part.lon for part, _ in blocks]), field.lon)
    with pytest.raises(FieldError, match="10 of 10"):
        list(stream_columns(table[20:30], ["periods"], 10))


def test_columns_that_are_no_numbers(table):
    with pytest.raises(TableError, match="no column 'nothing'"):
        read_columns(table, ["nothing"])
    with pytest.raises(FieldError, match="text"):
        read_columns(table, ["sort"])


def test_template_of_large_numbers(table, tmp_path, capsys):
    """Numbers beyond 50 were taken as missing magnitudes."""
    from fit.commands.fit import main

    rng = np.random.default_rng(2)
    n = 600
    lon, lat = rng.uniform(0, 360, n), np.degrees(np.arcsin(rng.uniform(-1, 1, n)))
    made = Table({"ra": lon, "dec": lat, "pmra": rng.normal(size=n), "pmdec": rng.normal(size=n)})
    made["pmra_error"] = made["pmdec_error"] = 1.0
    made["mjd"] = 57_000 + 100 * np.sin(2 * np.radians(lat))
    made["tilt"] = np.sin(np.radians(lat))
    made.write(tmp_path / "q.fits")
    assert main([str(tmp_path / "q.fits"), "--lmax", "3", "--templates", "mjd"]) == 0
    assert "template mjd, along" in capsys.readouterr().out
    assert main([str(tmp_path / "q.fits"), "--lmax", "3", "--templates", "tilt"]) == 1
    assert "has degree 1 alone" in capsys.readouterr().err


@pytest.mark.parametrize("mark", [9.99, 99.0, 999.0, 99.99])
def test_marks_of_unknown_redshifts_are_no_redshifts(table, mark):
    """A survey writes 9.99 or 999 where it has none; a single 9.99 may be one."""
    table = Table(table)
    table["redshift"] = np.linspace(0.1, 3.0, len(table))
    table["redshift"][:3] = mark
    field = read_field(table)
    assert np.isnan(field.redshift).tolist() == [True] * 3 + [False] * (len(field) - 3)
    assert any("3 values of redshift" in note for note in field.notes)
    table["redshift"][1:3] = 1.0
    assert np.isnan(read_field(table).redshift[0]) == (mark > 20)


@pytest.mark.parametrize(("factor", "is_doubted"), [(1.0, False), (3.0, False), (1e-3, True), (1e3, True)])
def test_distances_that_redshifts_contradict_are_doubted(table, factor, is_doubted):
    """Distances in kpc that were taken in Mpc gave a velocity of zero without a word."""
    table = Table(table)
    table["redshift"] = np.linspace(0.01, 0.1, len(table))
    table["distance"] = factor * 4283 * table["redshift"]
    table["distance_error"] = table["distance"] / 5
    table["distance"].unit = table["distance_error"].unit = "Mpc"
    names = ("distance", "distance_error")
    with pytest.warns(match="times those by the redshifts") if is_doubted else nullcontext():
        field = read_field(table, {name: name for name in names}, roles=("redshift", *names))
    assert any("times those by the redshifts" in note for note in field.notes) == is_doubted
