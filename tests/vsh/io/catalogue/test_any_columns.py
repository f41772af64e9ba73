"""Columns of any meaning, at the rows that a field keeps."""

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

from vsh.io.catalogue import read_columns, read_field
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


def test_what_is_no_column_of_numbers(table):
    with pytest.raises(TableError, match="no column 'nothing'"):
        read_columns(table, ["nothing"])
    with pytest.raises(FieldError, match="text"):
        read_columns(table, ["sort"])


def test_a_template_of_large_numbers(table, tmp_path, capsys):
    """Numbers beyond 50 were taken for missing magnitudes."""
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
