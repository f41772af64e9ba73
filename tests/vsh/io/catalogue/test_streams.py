"""Catalogues in blocks."""

import gzip
import sys

import numpy as np
import pyarrow.parquet
import pytest
from astropy.table import MaskedColumn, Table
from gaia_table import N, check, table

import fit
from vsh import Modes
from vsh.io.catalogue import read_field, stream_fields
from vsh.tools.errors import FieldError, TableError, VshError


def written(ending, folder):
    """The table as astropy writes it: packed where the name says so, or the rows of three files in folders."""
    if ending == "folder":
        for i, part in enumerate((table()[:10], table()[10:], table()[:0])):
            (folder / "parts" / f"sub{i}").mkdir(parents=True)
            part.write(folder / "parts" / f"sub{i}" / "part.parquet")
        (folder / "parts" / "_metadata").write_text("not a table")
        return folder / "parts"
    path = folder / f"c.{ending.removesuffix('.gz')}"
    table().write(path, **({"format": "votable"} if ending == "vot" else {}))
    if ending.endswith(".gz"):
        path = folder / f"c.{ending}"
        path.write_bytes(gzip.compress(path.with_suffix("").read_bytes()))
    return path


@pytest.mark.parametrize("ending", ["fits", "fits.gz", "ecsv", "csv", "csv.gz", "vot", "parquet", "folder"])
@pytest.mark.parametrize("rows", [7, 10, 1000])
def test_blocks_are_the_whole(tmp_path, ending, rows):
    path = written(ending, tmp_path)
    whole, parts = read_field(path), list(stream_fields(path, rows=rows))
    check(whole)
    assert [len(part) for part in parts[:-1]] == [rows] * (len(parts) - 1)
    for name in ("lon", "lat", "motion", "sigma", "rho", "name", "redshift", "magnitude"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts], -1), getattr(whole, name))
    assert parts[0].name.dtype == np.int64
    if "csv" in ending and ending != "ecsv":
        assert whole.notes[0] == "no unit in the table, so taken in deg: ra, dec"
        assert whole.notes[1] == "no unit in the table, so taken in mas / yr: pmra, pmdec, pmra_error, pmdec_error"
    else:
        assert all(part.notes == () for part in (whole, *parts))  # units came with the file
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
    path = written("parquet", tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow.dataset", None)
    with pytest.raises(TableError, match=r"pip install 'vsh-astrometry\[parquet\]'"):
        list(stream_fields(path))
