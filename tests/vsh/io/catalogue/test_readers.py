"""One reader a format, for files and streams alike; no number that was not checked."""

import gzip
import io
import re
import warnings

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
import pytest
from astropy import units as u
from astropy.io import fits
from astropy.table import QTable, Table
from gaia_table import N, Stream, check, table

from vsh.io import tables
from vsh.io.catalogue import read_field, read_sources, stream_fields
from vsh.tools.errors import EmptyFieldError, FieldError, TableError


def gaia_bulk(path, wide=True, first=0):
    """A file as Gaia hands them round: ECSV inside, .csv.gz by name, commas, null, quoted designations."""
    t, text = table(), io.StringIO()
    t["source_id"] += first
    t.add_column([f"Gaia DR3 {name}" for name in t["source_id"]], 1, "designation")
    if wide:
        t["extra"] = "null"
    t.meta["release"] = "Gaia XX"
    t.write(text, format="ascii.ecsv", delimiter=",")
    quoted = re.sub(r"Gaia DR3 \d+", r'"\g<0>"', text.getvalue().replace("mas / yr", "mas.yr**-1"))
    path.write_bytes(gzip.compress(quoted.encode()))
    return path


def test_gaia_bulk_files_are_known_by_their_first_bytes(tmp_path):
    """Refused, alone and as a folder."""
    field = read_field(gaia_bulk(tmp_path / "GaiaSource_000000-003111.csv.gz"))
    check(field)
    assert field.notes == ()  # units came with the file
    gaia_bulk(tmp_path / "GaiaSource_003112-005263.csv.gz", wide=False, first=100)
    folder = list(stream_fields(tmp_path, rows=25))
    assert [len(part) for part in folder] == [25, 5, 25, 5]
    assert len(read_field(tmp_path)) == 2 * N


@pytest.mark.parametrize("scaled", [False, True])
def test_nulls_of_scaled_columns_are_missing(tmp_path, scaled):
    """Rows without a value came out as −32768 mas/yr."""
    t = table(units=False)
    raw = np.arange(N, dtype=np.int16)
    raw[4] = -32768
    columns = [fits.Column(n, "D", array=t[n]) for n in ("ra", "dec", "pmdec", "pmra_error", "pmdec_error")]
    values = raw * 0.5 + 1 if scaled else raw
    columns.append(fits.Column("pmra", "I", array=raw, null=-32768))
    fits.BinTableHDU.from_columns(columns).writeto(tmp_path / "c.fits")
    for key, value in {"TSCAL6": 0.5, "TZERO6": 1.0}.items() if scaled else ():
        fits.setval(tmp_path / "c.fits", key, value=value, ext=1)
    for read in (lambda p: [read_field(p, on_bad="drop")], lambda p: list(stream_fields(p, rows=11, on_bad="drop"))):
        parts = read(tmp_path / "c.fits")
        motion = np.concatenate([part.motion[0] for part in parts])
        np.testing.assert_allclose(motion, 1000 * np.delete(values.astype(float), 4))
        assert any("pmra missing: 1" in note for part in parts for note in part.notes)


@pytest.mark.parametrize("unit", ["mag(mas/yr)", "dex(mas/yr)", "dB(mas/yr)", "-1 mas/yr"])
def test_units_that_are_not_linear_are_refused(unit):
    """They passed as factors of 0.4, 10, 1.26 and −1."""
    with pytest.raises(TableError, match="pmra.*(logarithm|a negative unit|no unit that astropy knows)"):
        read_field(table(), units={"pmra": unit})


@pytest.mark.filterwarnings("ignore:warning. half of the errors are below")
@pytest.mark.parametrize("unit", ["uas/yr", "mas.yr**-1", "mas yr-1", "mas / yr", "marcsec/yr"])
def test_units_in_every_spelling_by_every_way(tmp_path, unit):
    """Uas/yr in a FITS file was refused by one reader and taken by the other."""
    t = table(units=False)
    columns = [fits.Column(n, "D", array=t[n], unit=unit if n.startswith("pm") and "corr" not in n else None)
               for n in t.colnames if n != "source_id"]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fits.BinTableHDU.from_columns(columns).writeto(tmp_path / "c.fits")
    factor = 1 if unit == "uas/yr" else 1000
    for field in (read_field(tmp_path / "c.fits"), next(stream_fields(tmp_path / "c.fits"))):
        np.testing.assert_allclose(field.motion[0], factor * t["pmra"])


def test_columns_in_another_frame_are_asked_for():
    """L and b given as ra and dec were taken as ICRS."""
    t = table()
    t.rename_columns(["ra", "dec", "pmra", "pmdec"], ["l", "b", "east", "north"])
    columns = {"ra": "l", "dec": "b", "pmra": "east", "pmdec": "north"}
    with pytest.raises(
        TableError, match="'l' is given as ra: are these galactic coordinates.*--columns frame=galactic"
    ):
        read_field(t, columns)
    assert read_field(t, columns, frame="galactic").frame == "galactic"
    assert read_field(t, columns, frame="icrs").frame == "icrs"
    with pytest.raises(TableError, match="galactic"):
        read_sources(t, columns)


def test_one_component_of_minus_99_is_a_motion_two_are_not():
    t = table()
    t["pmra"][3] = -99
    assert len(read_field(t)) == N
    t["pmdec"][3] = -99
    assert len(read_field(t, on_bad="drop")) == N - 1


def test_velocity_is_no_redshift():
    t = table()
    t["cz"] = 3000.0 * u.km / u.s
    with pytest.raises(TableError, match="'cz' is in 'km / s', not a redshift"):
        read_field(t, {"redshift": "cz"})


def test_first_of_several_tables_is_said(tmp_path):
    others = [Table({"x": [1.0]}), Table({"y": [1.0]})]
    hdus = [fits.table_to_hdu(each) for each in (table(units=False), *others)]
    fits.HDUList([fits.PrimaryHDU(), *hdus]).writeto(tmp_path / "c.fits")
    for field in (read_field(tmp_path / "c.fits"), next(stream_fields(tmp_path / "c.fits"))):
        assert "holds 3 tables; the first was read (extension 1)" in field.notes[0]


@pytest.mark.parametrize("state", ["OVERFLOW", "ERROR"])
def test_truncated_archive_result_is_refused(tmp_path, state):
    path = tmp_path / "c.vot"
    table().write(path, format="votable")
    info = f'<INFO name="QUERY_STATUS" value="{state}">too many rows</INFO>'
    path.write_text(path.read_text().replace("</RESOURCE>", f"{info}</RESOURCE>"))
    with pytest.raises(TableError, match="the archive cut it off" if state == "OVERFLOW" else "archive's error"):
        read_field(path)
    path.write_text(path.read_text().replace(state, "OK"))
    check(read_field(path))


def test_lowered_count_of_rows_is_seen(tmp_path):
    """Iter_fields took it."""
    tables.write_table(table(), tmp_path / "c.fits")
    content = (tmp_path / "c.fits").read_bytes()
    assert content.count(b"NAXIS2  =                   30") == 1
    (tmp_path / "c.fits").write_bytes(
        content.replace(b"NAXIS2  =                   30", b"NAXIS2  =                   20")
    )
    for read in (read_field, lambda path: list(stream_fields(path))):
        with pytest.raises(TableError, match="data behind the last of the declared rows"):
            read(tmp_path / "c.fits")


@pytest.mark.parametrize("packed", [False, True])
def test_declared_sizes_are_held_against_the_file(tmp_path, packed):
    """NAXIS = 9999999999999999 did not end in a minute."""
    tables.write_table(table(), tmp_path / "c.fits")
    content = (tmp_path / "c.fits").read_bytes()
    content = content.replace(b"NAXIS2  =                   30", b"NAXIS2  =     9999999999999999")
    path = tmp_path / ("c.fits.gz" if packed else "c.fits")
    path.write_bytes(gzip.compress(content) if packed else content)
    with pytest.raises(TableError, match="declares .* bytes where"):
        read_field(path)
    content = content.replace(b"BITPIX  =                    8", b"BITPIX  = 'eight   '          ")
    path.write_bytes(gzip.compress(content) if packed else content)
    with pytest.raises(TableError, match="is damaged: a header declares sizes"):
        read_field(path)


def test_giant_field_is_refused_before_it_is_stored(tmp_path):
    """3 MB took 4.8 GB."""
    path = tmp_path / "c.csv"
    table(units=False).write(path)
    lines = path.read_text().splitlines()
    lines[5] = lines[5].replace(lines[5].split(",")[2], "1" * 3_000_000)
    path.write_text("\n".join(lines))
    with pytest.raises(TableError, match=r"line 6: a field of 3000000 characters in column 'dec'"):
        read_field(path)


def test_fields_with_quotes_commas_and_line_breaks(tmp_path):
    t = table(units=False)
    t["name"] = ['a "quoted", name\nin two lines' if i == 3 else f"n{i}, {i}" for i in range(N)]
    t.remove_column("source_id")
    t.write(tmp_path / "c.csv")
    field = read_field(tmp_path / "c.csv")
    assert field.name[3] == 'a "quoted", name\nin two lines'
    assert field.name[4] == "n4, 4"
    np.testing.assert_allclose(field.motion[0], 1000 * t["pmra"])


class Nested(pandas.DataFrame):
    """As LSDB's NestedFrame: made from a DataFrame, in another module."""


def arrow_table():
    t = table(units=False)
    return pyarrow.table({name: np.array(t[name]) for name in t.colnames})


@pytest.mark.parametrize(
    "make",
    [
        lambda: table(units=False).to_pandas(),
        lambda: Nested(table(units=False).to_pandas()),
        arrow_table,
        lambda: arrow_table().to_batches()[0],
        lambda: Stream(arrow_table()),
        lambda: arrow_table().to_reader(),
        table,
        lambda: QTable(table()),
        lambda: dict(table(units=False).columns.items()),
        lambda: table(units=False).as_array(),
    ],
    ids=["pandas", "NestedFrame", "Table", "RecordBatch", "stream", "reader", "astropy", "QTable", "dict", "records"],
)
def test_objects_in_memory(make):
    """Module names of types were compared."""
    check(read_field(make()))
    assert [len(part) for part in stream_fields(make(), rows=20)] == [20, 10]


def test_only_the_columns_that_are_needed_are_read(tmp_path):
    arrow = arrow_table()
    for i in range(20):
        arrow = arrow.append_column(f"more{i}", pyarrow.array(["x"] * N))
    pyarrow.parquet.write_table(arrow, tmp_path / "wide.parquet")
    source = tables.open_table(tmp_path / "wide.parquet")
    asked = []
    original = source.read
    object.__setattr__(source, "read", lambda names, rows: asked.append(names) or original(names, rows))
    check(read_field(source))
    assert set(asked[0]) == set(table().colnames)


def test_block_without_a_usable_row_is_no_end(tmp_path):
    t = table()
    t["pmra"][10:20] = np.nan
    t["pmra"][25:] = np.nan
    tables.write_table(t, tmp_path / "c.fits")
    parts = list(stream_fields(tmp_path / "c.fits", rows=5, on_bad="drop"))
    assert sum(map(len, parts)) == 15
    import fit

    notes = fit.normal_equations(parts, 1).notes
    assert notes == ("left out 15 of 30 rows: proper motion not finite: 15",)
    t["pmra"] = np.nan
    tables.write_table(t, tmp_path / "none.fits")
    with pytest.raises(EmptyFieldError, match="No row is left"):
        list(stream_fields(tmp_path / "none.fits", rows=5, on_bad="drop"))


def test_rows_are_numbered_through_the_file(tmp_path):
    t = table()
    t["pmra"][17] = np.nan
    tables.write_table(t, tmp_path / "c.fits")
    with pytest.raises(FieldError, match=r"\(row 17\)"):
        list(stream_fields(tmp_path / "c.fits", rows=5))


def test_address_where_nobody_answers():
    """'https:/…: no such file'; and no password in a message."""
    with pytest.raises(TableError, match="^https://127.0.0.1:9/c.fits ") as error:
        read_field("https://me:secret@127.0.0.1:9/c.fits?key=secret")
    assert "secret" not in str(error.value)


def test_control_characters_do_not_reach_messages(tmp_path):
    t = table()
    t.rename_column("pmra", "pm\x1b[31mra")
    with pytest.raises(TableError) as error:
        read_field(t)
    assert "\x1b" not in str(error.value)
    assert "\\x1b[31mra" in str(error.value)
    with pytest.raises(TableError) as error:
        read_field(tmp_path / "none\x1b[2J.fits")
    assert "\x1b" not in str(error.value)


@pytest.mark.parametrize("ending", ["ecsv", "csv", "fits", "vot"])
def test_name_with_gz_is_a_compressed_file(tmp_path, ending):
    tables.write_columns(tmp_path / f"t.{ending}.gz", {"x": [1.5, 2.5]})
    assert (tmp_path / f"t.{ending}.gz").read_bytes()[:2] == b"\x1f\x8b"
    assert tables.read_table(tmp_path / f"t.{ending}.gz")["x"].tolist() == [1.5, 2.5]


def test_parquet_is_compressed_by_itself(tmp_path):
    with pytest.raises(TableError, match="leave out the .gz"):
        tables.write_columns(tmp_path / "t.parquet.gz", {"x": [1.5]})


def test_votables_keep_metadata_whole(tmp_path):
    meta = {"SEED": 2**60 + 1, "SIZE": 1.5, "NOTES": ["one", "two µ"], "FLAG": True, "NAME": "x"}
    tables.write_columns(tmp_path / "t.vot", {"x": [1.5]}, meta)
    again = tables.read_table(tmp_path / "t.vot").meta
    assert int(again["SEED"]) == 2**60 + 1
    assert (again["SIZE"], again["NOTES"], again["FLAG"], again["NAME"]) == (1.5, '["one", "two µ"]', "True", "x")


def test_line_without_an_end_is_refused(tmp_path, monkeypatch):
    """A file without line feeds is no table, and is not read into memory whole."""
    monkeypatch.setattr("vsh.io.tables._text.LINE", 200)
    (tmp_path / "one.csv").write_text("ra,dec,pmra,pmdec,pmra_error,pmdec_error\n" + "1.5," * 300)
    with pytest.raises(TableError, match="a line of more than 200 characters"):
        read_field(tmp_path / "one.csv")
