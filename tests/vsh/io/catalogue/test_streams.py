"""Catalogues in blocks."""

import sys

import numpy as np
import pyarrow.parquet
import pytest
from astropy.table import MaskedColumn, Table
from gaia_table import N, table

import fit
from vsh import Modes
from vsh.io.catalogue import read_field, stream_fields
from vsh.tools.errors import FieldError, TableError, VshError


def folder(tmp_path):
    for i, part in enumerate((table()[:10], table()[10:], table()[:0])):
        (tmp_path / "parts" / f"sub{i}").mkdir(parents=True)
        part.write(tmp_path / "parts" / f"sub{i}" / "part.parquet")
    (tmp_path / "parts" / "_metadata").write_text("not a table")
    return tmp_path / "parts"


def fits_file(tmp_path):
    table().write(tmp_path / "c.fits")
    return tmp_path / "c.fits"


def parquet_file(tmp_path):
    table().write(tmp_path / "c.parquet")
    return tmp_path / "c.parquet"


@pytest.mark.parametrize("make", [fits_file, parquet_file, folder])
@pytest.mark.parametrize("rows", [7, 10, 1000])
def test_blocks_are_the_whole(tmp_path, make, rows):
    whole = read_field(table())
    parts = list(stream_fields(make(tmp_path), rows=rows))
    assert [len(part) for part in parts[:-1]] == [rows] * (len(parts) - 1)
    for name in ("lon", "lat", "motion", "sigma", "rho", "name", "redshift", "magnitude"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts], -1), getattr(whole, name))
    assert all(part.notes == () for part in parts)  # units came with the file
    assert parts[0].name.dtype == np.int64
    one, two = fit.normal_equations(parts, Modes(1)), fit.normal_equations(whole, Modes(1))
    np.testing.assert_allclose(one.matrix, two.matrix, atol=1e-12 * np.abs(two.matrix).max())


@pytest.mark.parametrize("ending", ["fits", "parquet"])
def test_rows_left_out_are_added_up(tmp_path, ending):
    t = table()
    t["pmra"][[2, 25]] = np.nan
    t["pmdec_error"][12] = -1
    t.write(tmp_path / f"c.{ending}")
    with pytest.raises(FieldError, match="1 of 10 rows cannot be used"):
        list(stream_fields(tmp_path / f"c.{ending}", rows=10))
    normal = fit.normal_equations(stream_fields(tmp_path / f"c.{ending}", rows=10, on_bad="drop"), Modes(1))
    notes = fit.solve(normal).notes
    assert notes == ("left out 3 of 30 rows: proper motion not finite: 2; σ ≤ 0: 1",)


def test_masked_integers_stay_integers(tmp_path):
    t = table()
    t["source_id"] = MaskedColumn(t["source_id"], mask=np.arange(N) == 3)
    t.write(tmp_path / "astropy.parquet")  # the mask beside the values
    arrow = pyarrow.table({name: t[name].tolist() for name in t.colnames})  # a null in their place
    pyarrow.parquet.write_table(arrow, tmp_path / "arrow.parquet")
    for writer in ("astropy", "arrow"):
        names = next(iter(stream_fields(tmp_path / f"{writer}.parquet"))).name
        assert (names[3], names[29]) == ("", "4000000000000000030")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.fits", None, "no such file"),
        ("a.txt", b"ra,dec\0\n", "unrecognised format"),
        ("a.fits", b"SIMPLE", "header at byte 0 does not end"),
        ("a.parquet", b"PAR1", "cannot be read as Parquet"),
    ],
)
def test_bad_files(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(TableError, match=message):
        list(stream_fields(tmp_path / name))


def test_bad_folders(tmp_path):
    with pytest.raises(TableError, match="is a folder without tables"):
        list(stream_fields(tmp_path))
    (tmp_path / "collection.properties").write_text("hats")
    with pytest.raises(TableError, match="HATS collection, whose margin cache repeats sources"):
        list(stream_fields(tmp_path))
    with pytest.raises(VshError, match="rows must be a whole number of at least 1"):
        list(stream_fields(tmp_path, rows=0))
    Table({"a": []}).write(tmp_path / "image.fits")


def test_parquet_without_pyarrow_says_what_to_install(tmp_path, monkeypatch):
    path = parquet_file(tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow.dataset", None)
    with pytest.raises(TableError, match=r"pip install 'vsh-astrometry\[parquet\]'"):
        list(stream_fields(path))
