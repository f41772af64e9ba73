"""One reader for every container that epochs come in: all give the same five parameters."""

import base64
import struct

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Column, MaskedColumn, Table

import sim
from vsh.io.epochs import read_epochs, read_observations, solve_epochs
from vsh.io.epochs._observations import convert_column_to_numbers
from vsh.tools.errors import TableError

_KINDS = {"i8": "long", "f8": "double", "b1": "boolean"}
_ARRAYS = ("obs_time_tcb", "centroid_pos_al", "centroid_pos_error_al", "used_by_agis_al")


@pytest.fixture(scope="module")
def transits():
    """Transits as the pre-release of Gaia DR4 has them: arrays of any length, none of some columns, nulls."""
    table = sim.epochs(sim.quasars(8, rng=1, max_magnitude=19), sim.spin((0, 0, 500)), rng=2)
    rng = np.random.default_rng(0)
    ragged = Table()
    short = rng.random(len(table)) < 0.2  # some transits have eight CCDs
    for name in table.colnames:
        column = table[name]
        if column.ndim == 1:
            ragged[name] = column
            continue
        rows = np.empty(len(table), object)
        for i in range(len(table)):
            rows[i] = np.ma.array(column[i][: 8 if short[i] else 9])
        ragged[name] = Column(rows, unit=column.unit)
    none = np.empty(len(table), object)
    none[:] = [np.ma.array(np.zeros(0)) for _ in table]
    ragged["centroid_pos_ac"] = Column(none)
    hidden = rng.random(len(table)) < 0.1
    for name in ("parallax_factor_al", "obs_time_bary_corr"):
        ragged[name] = MaskedColumn(ragged[name], mask=hidden)
    for i in np.flatnonzero(hidden):
        ragged["used_by_agis_al"][i][:] = False
    return ragged


def write_binary2(table, path):
    """As ESA wrote it: arraysize="*", a mask of nulls before each row, a count before each array."""
    kinds = {
        n: (np.asarray(table[n][0]) if table[n].dtype == object else table[n]).dtype.str[1:] for n in table.colnames
    }
    fields = "".join(
        f'<FIELD name="{n}" datatype="{_KINDS[kinds[n]]}"'
        + (' arraysize="*"' if table[n].dtype == object else "")
        + (f' unit="{table[n].unit}"' if table[n].unit is not None else "")
        + "/>"
        for n in table.colnames
    )
    out, width = bytearray(), (len(table.colnames) + 7) // 8

    def encoded(values, kind):
        values = np.atleast_1d(values)
        return b"".join(b"T" if x else b"F" for x in values) if kind == "b1" else values.astype(">" + kind).tobytes()

    for row in table:
        null = [table[n].dtype != object and np.ma.is_masked(row[n]) for n in table.colnames]
        out += int("".join("1" if each else "0" for each in null).ljust(8 * width, "0"), 2).to_bytes(width, "big")
        for n, missing in zip(table.colnames, null, strict=True):
            if table[n].dtype == object:
                out += struct.pack(">i", len(row[n]))
            out += encoded(0 if missing else np.asarray(row[n]), kinds[n])
    path.write_text(
        '<?xml version="1.0"?><VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">'
        f'<RESOURCE type="results"><TABLE>{fields}<DATA><BINARY2><STREAM encoding="base64">'
        f"{base64.b64encode(bytes(out)).decode()}</STREAM></BINARY2></DATA></TABLE></RESOURCE></VOTABLE>",
        encoding="utf-8",
    )
    return path


def write_fits(table, path, code):
    """Columns of arrays of any length, whose descriptors have 32 bits (P) or 64 (Q)."""
    columns = []
    for name in table.colnames:
        column = table[name]
        if name in _ARRAYS:
            kind = {"i8": "K", "f8": "D", "b1": "L"}[np.asarray(column[0]).dtype.str[1:]]
            rows = np.empty(len(table), object)
            rows[:] = [np.asarray(each) for each in column]
            columns.append(fits.Column(name, f"{code}{kind}()", array=rows))
        elif column.dtype != object:
            null = -99 if column.dtype.kind == "i" and hasattr(column, "mask") else None
            values = column.filled(np.nan if column.dtype.kind == "f" else -99) if hasattr(column, "mask") else column
            columns.append(fits.Column(name, {"i8": "K", "f8": "D"}[column.dtype.str[1:]], array=values, null=null))
    fits.BinTableHDU.from_columns(columns).writeto(path)
    return path


def containers(table, tmp_path):
    """The table in every container, by name."""
    pandas, pyarrow = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    polars, parquet = pytest.importorskip("polars"), pytest.importorskip("pyarrow.parquet")
    votable = write_binary2(table, tmp_path / "epochs.xml")
    frame = Table.read(votable, format="votable").to_pandas()
    arrow = pyarrow.Table.from_pandas(frame)
    parquet.write_table(arrow, tmp_path / "epochs.parquet")
    table.write(tmp_path / "epochs.ecsv")
    whole = [name for name in table.colnames if name not in (*_ARRAYS, "centroid_pos_ac")]
    exploded = frame[[*_ARRAYS, *whole]].explode(list(_ARRAYS))
    exploded.to_csv(tmp_path / "epochs.csv", index=False)
    assert isinstance(frame, pandas.DataFrame)
    return {
        "astropy": table,
        "VOTable": votable,
        "pandas": frame,
        "exploded pandas": exploded,
        "Arrow": arrow,
        "Parquet": tmp_path / "epochs.parquet",
        "polars": polars.from_arrow(arrow),
        "ECSV": tmp_path / "epochs.ecsv",
        "CSV": tmp_path / "epochs.csv",
        "FITS P": write_fits(table, tmp_path / "p.fits", "P"),
        "FITS Q": write_fits(table, tmp_path / "q.fits", "Q"),
    }


def test_every_container_gives_the_same_five_parameters(transits, tmp_path):
    five = {}
    for name, source in containers(transits, tmp_path).items():
        seen = read_observations(source)
        solved = solve_epochs(seen.source, seen.design, seen.position, seen.error)
        five[name] = solved.values
        note = next(note for note in seen.notes if str(note).startswith("observations: left out"))
        assert "not used by AGIS" in str(note), name
        assert "without a position" not in str(note), name  # a CCD that is not there is no bad observation
        assert seen.view is not None, name
    for name, values in five.items():
        np.testing.assert_allclose(values, five["astropy"], rtol=1e-12, err_msg=name)
    assert read_epochs(transits).motion.shape == (2, 8)


@pytest.mark.parametrize(("origin", "words"), [(2455197.5, "Julian dates"), (55197.0, "modified Julian dates")])
@pytest.mark.parametrize("unit", [None, "d"])
def test_times_in_days_are_known(transits, origin, words, unit):
    days = transits.copy()
    times = np.array([np.asarray(row, float).mean() for row in transits["obs_time_tcb"]]) / 86400e9 + origin
    for name in _ARRAYS[1:]:
        days[name] = [np.asarray(row)[0] for row in transits[name]]
    days["obs_time_tcb"] = Column(times, unit=unit)
    seen = read_observations(days)
    assert any(f"obs_time_tcb holds {words}" in note for note in seen.notes)
    assert np.abs(seen.time).max() < 6


def test_bad_columns_are_named(transits):
    wrong = transits.copy()
    wrong["centroid_pos_al"] = ["here"] * len(wrong)
    with pytest.raises(TableError, match="column 'centroid_pos_al' holds 'here', which is no number"):
        read_observations(wrong)
    longer = transits.copy()
    rows = np.empty(len(longer), object)
    rows[:] = [np.zeros(4) for _ in range(len(longer))]
    longer["centroid_pos_error_al"] = rows
    with pytest.raises(TableError, match="'centroid_pos_error_al' has 4 numbers per transit where"):
        read_observations(longer)


def test_matrix_of_keeps_integers_and_missing_values():
    big = 2**62 + 1
    values, mask, padding = convert_column_to_numbers(np.array([[big, None], [1], None, []], object), None, "t", "x")
    assert values.dtype == np.int64
    assert values[0, 0] == big
    np.testing.assert_array_equal(mask, [[False, True], [False, False], [True, True], [False, False]])
    np.testing.assert_array_equal(padding[[1, 3]], [[False, True], [True, True]])
    words, mask, _ = convert_column_to_numbers(np.array(["True", "f", "null", "1"]), None, "used", "x")
    np.testing.assert_array_equal(words[[0, 1, 3]], [1, 0, 1])
    np.testing.assert_array_equal(mask, [False, False, True, False])
    lists, _, _ = convert_column_to_numbers(np.array(["[1.5, null]", "[2, 3]"]), None, "w", "x")
    np.testing.assert_array_equal(lists[1], [2, 3])


@pytest.mark.parametrize("text", ["[1.5, nan, 2.0]", "(1.5, NaN, 2.)", "[1.5, None, 2.]", "{1.5, nan, 2.0}"])
def test_lists_as_pandas_writes_them(text):
    values, absent, _ = convert_column_to_numbers(np.array([text, "[3., 4., inf]"]), None, "x", "a.csv")
    assert values[0, 0] == 1.5
    assert values[0, 2] == 2.0
    assert np.isnan(values[0, 1]) or absent[0, 1]
    assert np.isinf(values[1, 2]) or absent[1, 2]
