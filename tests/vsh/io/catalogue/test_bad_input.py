"""Every kind of bad table, and what its owner is told. None may end in a library's traceback."""

import ast
import gzip
import re
import shlex

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table
from gaia_table import NAMES, N, table

import fit
from fit.commands.fit import main
from vsh import VshWarning
from vsh.io.catalogue import read_field, stream_fields
from vsh.tools.errors import DegeneracyError, FieldError, TableError


def set_value(name, value, rows=slice(3, 4)):
    def change(t):
        column = np.array(t[name], float)
        column[rows] = value
        t[name] = MaskedColumn(column, unit=t[name].unit)
        return t

    return change


def set_unit(name, unit):
    def change(t):
        t[name].unit = unit
        return t

    return change


def replaced(name, values):
    def change(t):
        t[name] = values
        return t

    return change


def masked(name, mask):
    return lambda t: replaced(name, MaskedColumn(t[name], mask=mask))(t)


def radians(t):
    for name in ("ra", "dec"):
        t[name] = np.radians(t[name].value)
    return t


#: (what was done to the table, the message it gets)
TABLES = {
    **{f"no column {c}": (lambda t, c=c: Table(t, names=[n + "x" * (n == c) for n in t.colnames]),
                          f"no column '{c}'. The table has source_id, .*nearest: .*{c}x") for c in NAMES},
    "proper motion in km/s": (set_unit("pmra", "km / s"), "column 'pmra' is in 'km / s', which cannot be turned into mas / yr"),
    "error in mas": (set_unit("pmra_error", "mas"), "column 'pmra_error' is in 'mas', which cannot be turned"),
    "position in mag": (set_unit("ra", "mag"), "column 'ra' is in 'mag', which cannot be turned into deg"),
    "text in a column of numbers": (replaced("pmra", ["1.0"] * (N - 1) + ["bright"]), "pmra holds text .'bright' in row 29."),
    "truth values": (replaced("pmra", [True] * N), "pmra holds bool, not real numbers"),
    "complex numbers": (replaced("pmra", [1j] * N), "pmra holds complex128, not real numbers"),
    "all masked": (masked("pmdec", True), "30 of 30 rows cannot be used: pmdec missing: 30 .*No row is left"),
    "one masked": (masked("pmdec_error", np.arange(N) == 5), "1 of 30 rows cannot be used: pmdec_error missing: 1 .row 5."),
    "one NaN": (set_value("pmra", np.nan), "proper motion not finite: 1 .row 3..*--on-bad drop"),
    "one NaN position": (set_value("dec", np.nan), "position not finite: 1 .row 3."),
    "an infinite error": (set_value("pmra_error", np.inf), "error not finite: 1 .row 3."),
    "many NaN": (set_value("pmra", np.nan, slice(0, 9)), "proper motion not finite: 9 .rows 0, 1, 2, 3, 4, …."),
    "sigma zero": (set_value("pmra_error", 0.0), "σ ≤ 0: 1 .row 3."),
    "sigma negative": (set_value("pmdec_error", -0.1), "σ ≤ 0: 1 .row 3."),
    "sigma too small to square": (set_value("pmdec_error", 1e-200), "σ too small for a number: 1 .row 3."),
    "sigma too large to square": (set_value("pmdec_error", 1e200), "σ too large for a number: 1 .row 3."),
    "rho one": (set_value("pmra_pmdec_corr", 1.0), "ρ² ≥ 1 − 1e-6: 1 .row 3."),
    "rho minus almost one": (set_value("pmra_pmdec_corr", -1 + 1e-11), "ρ² ≥ 1 − 1e-6: 1 .row 3."),
    "rho two": (set_value("pmra_pmdec_corr", 2.0), "ρ² ≥ 1 − 1e-6: 1 .row 3."),
    "rho NaN": (set_value("pmra_pmdec_corr", np.nan), "correlation not finite: 1 .row 3."),
    "mark in ra": (set_value("ra", -9999.0), "ra outside .*: 1 .row 3."),
    "mark in pmra": (set_value("pmra", -9999.0), "a value such as -9999 .*: 1 .row 3."),
    "mark in an error": (set_value("pmdec_error", 99999.0), "a value such as -9999 .*: 1 .row 3."),
    "ra beyond any turn": (set_value("ra", 1e6), "ra outside .*: 1 .row 3."),
    "motion too large to square": (set_value("pmra", 1e160), "proper motion too large for a number: 1 .row 3."),
    "dec 95": (set_value("dec", 95.0), "|dec| > 90°: 1 .row 3."),
    "empty": (lambda t: t[:0], "the catalogue is empty"),
    "no columns": (lambda t: Table(), "no column 'ra'"),
    "two-dimensional column": (replaced("pmra", np.ones((N, 3))), r"pmra has shape \(30, 3\), expected \(30,\)"),
    "radians without a unit": (lambda t: radians(table(units=False)), "radians. Say units="),
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_table(kind):
    change, message = TABLES[kind]
    with pytest.raises((TableError, FieldError), match=message.replace("|dec|", r"\|dec\|")):
        read_field(change(table()))


@pytest.mark.parametrize(
    "kind", [k for k in TABLES if k.startswith(("one", "sigma", "rho", "dec", "many", "mark", "motion"))]
)
def test_dropped_rows_are_counted(kind):
    field = read_field(TABLES[kind][0](table()), on_bad="drop")
    assert len(field) == (21 if kind.startswith("many") else 29)
    assert f"left out {30 - len(field)} of 30 rows" in field.notes[-1]


def written(t, path, **options):
    t.write(path, **options)
    return path


def truncated(tmp_path):
    path = written(Table(table()[np.zeros(3000, int)]), tmp_path / "whole.fits")
    (tmp_path / "half.fits").write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return tmp_path / "half.fits"


def truncated_gzip(tmp_path):
    path = tmp_path / "half.csv.gz"
    whole = gzip.compress(b"ra,dec\n" + b"1.234,5.678\n" * 1000)
    path.write_bytes(whole[: len(whole) // 2])
    return path


def unknown_unit(tmp_path):
    path = written(table(), tmp_path / "odd.vot", format="votable")
    path.write_text(re.sub(r'name="pmra" unit="[^"]*"', 'name="pmra" unit="furlong.yr**-1"', path.read_text()))
    assert "furlong" in path.read_text()
    return path


def file_with(name, content):
    def make(tmp_path):
        (tmp_path / name).write_bytes(content)
        return tmp_path / name

    return make


def text_in_csv(tmp_path):
    path = written(table(units=False), tmp_path / "text.csv", format="ascii.csv")
    path.write_text(path.read_text().replace(str(table()["pmra"][4]), "n/a"))
    return path


RAGGED = b"ra,dec,pmra,pmdec,pmra_error,pmdec_error\n1,2,3,4,5,6\n1,2,3,4,5,6,7\n"
#: (how the file is made, the message it gets)
FILES = {
    "no such file": (lambda tmp: tmp / "none.fits", "none.fits: no such file"),
    "a folder": (lambda tmp: tmp, "is a folder without tables"),
    "unknown ending": (file_with("a.dat", b"1 2 3\0"), "unrecognised format. Known endings: .fits"),
    "not FITS": (file_with("a.fits", b"hello"), "a.fits is damaged or not FITS: a header begins with 'hello'"),
    "an empty file": (file_with("a.csv", b""), "a.csv is empty"),
    "an empty FITS": (file_with("a.fits", b""), "a.fits is empty"),
    "ragged CSV": (file_with("a.csv", RAGGED), "line 3 is damaged: 7 fields where the table has 6 columns"),
    "not a VOTable": (file_with("a.vot", b"<html></html>"), "a.vot cannot be read as VOTable"),
    "not Parquet": (file_with("a.parquet", b"PAR1"), "a.parquet cannot be read as Parquet"),
    "a FITS header without an end": (file_with("a.fits", b"SIMPLE"), "header at byte 0 does not end"),
    "truncated FITS": (truncated, "half.fits is truncated .*: a header declares 240000 bytes where 118080 are left"),
    "truncated gzip": (truncated_gzip, "half.csv.gz cannot be unpacked: .*Fetch it again"),
    "text in CSV": (text_in_csv, "pmra holds text .'n/a' in row 4."),
    "VOTable with an unknown unit": (
        unknown_unit,
        "'furlong . yr'.*(is no unit that astropy knows|cannot be turned into).*units=",
    ),
}


@pytest.mark.parametrize("kind", FILES)
def test_file(kind, tmp_path, capsys):
    make, message = FILES[kind]
    path = make(tmp_path)
    for read in (read_field, lambda path: list(stream_fields(path))):
        with pytest.raises((TableError, FieldError), match=message):
            read(path)
    assert main([str(path)]) == 1
    assert capsys.readouterr().err.startswith("vsh-fit: error: ")


def test_unknown_unit_can_be_overridden(tmp_path):
    assert len(read_field(unknown_unit(tmp_path), units={"pmra": "mas/yr"})) == N


def test_duplicate_rows_are_told():
    with pytest.warns(VshWarning, match="2 rows repeat the source_id of another"):
        field = read_field(table()[[*range(N), 3, 4]])
    assert len(field) == N + 2


def test_one_row_is_a_field_but_no_fit():
    with pytest.raises(DegeneracyError, match="1 sources cannot separate 6 modes"):
        fit.fit_field(read_field(table()[:1]), 1)


def test_small_field_in_degrees_is_fine():
    """A survey of two degrees about the origin is no list of radians, once it says so."""
    t = radians(table(units=False))
    assert len(read_field(t, units={"ra": "deg", "dec": "deg"})) == N


@pytest.mark.parametrize(("arguments", "message"), [
    ({"units": {"pmx": "mas/yr"}}, "units: no column 'pmx'. .*nearest: pmra|units: no column 'pmx'"),
    ({"units": {"pmra": "parsnips"}}, "'parsnips'.*(is no unit that astropy knows|cannot be turned into)"),
    ({"columns": {"pm_ra": "pmra"}}, "nothing is called pm_ra; there are ra, dec, pmra"),
    ({"columns": {"redshift": "zed"}}, "no column 'zed'.*Say which it is: columns="),
    ({"on_bad": "ignore"}, "on_bad is 'raise' or 'drop', not 'ignore'"),
])  # fmt: skip
def test_wrong_arguments(arguments, message):
    with pytest.raises((TableError, FieldError), match=message):
        read_field(table(), **arguments)


def test_objects_that_are_no_table():
    with pytest.raises(TableError, match="a float is no table"):
        read_field(3.0)


def test_units_that_differ_are_noted():
    """µas fitted with errors in mas passed without a word: χ²/dof 0.000."""
    bad = table()
    for name in ("pmra", "pmdec"):
        bad[name].unit = "uas / yr"
    with pytest.warns(VshWarning, match="no motion is above"):
        notes = read_field(bad).notes
    (note,) = (note for note in notes if "different units" in note)
    assert "pmdec in units of 0.001 mas/yr, pmra_error in units of 1 mas/yr" in note
    assert not any("different units" in note for note in read_field(table()).notes)


def test_every_missing_column_is_named():
    bad = table()
    bad.remove_columns(["pmra", "pmdec_error"])
    with pytest.raises(TableError, match="no column 'pmra'.*missing too: pmdec_error. Say which"):
        read_field(bad)


@pytest.mark.parametrize("column", ["pmra", "pmdec_error"])
@pytest.mark.parametrize("mark", [-9999.0, 99999.0, 1e20])
def test_sentinels_are_recognised_in_any_unit(column, mark):
    """Found by a newcomer: in µas/yr −9999 was a motion."""
    made = table()
    for name in ("pmra", "pmdec", "pmra_error", "pmdec_error"):
        made[name] = 1000 * np.asarray(made[name], float)
        made[name].unit = "uas/yr"
    made[column][3] = abs(mark) if column.endswith("error") else mark
    with pytest.raises(FieldError, match="marks missing data"):
        read_field(made)
    assert len(read_field(made, on_bad="drop")) == len(made) - 1


def test_names_of_vizier_are_told():
    made = table()
    made.rename_columns(NAMES, ["RA_ICRS", "DE_ICRS", "pmRA", "pmDE", "e_pmRA", "e_pmDE"])
    assert read_field(made).notes[0].startswith("columns by their names (vizier): ra = RA_ICRS, dec = DE_ICRS, pmra")
    with pytest.raises(TableError, match=r"Say which it is: columns='vizier' \(--columns vizier\)"):
        read_field(made, "gaia")


@pytest.mark.parametrize("names", [
    ("ra1", "dec1", "pmra1", "pmdec1", "pmra_err1", "pmdec_err1"),
    ("Alpha", "Delta", "muAlphaStar", "muDelta", "sigMuAlpha", "sigMuDelta"),
    ("lon_deg", "lat_deg", "pm_lon", "pm_lat", "pm_lon_std", "pm_lat_std"),
])  # fmt: skip
def test_answer_in_a_question_is_complete(names):
    """Two rounds of questions, of columns and then of units, were one more than a user has patience for."""
    made = table()
    before = read_field(made)
    for old, new in zip(NAMES, names):
        made[new] = np.asarray(made[old])
        del made[old]
    made["parallax_error1"], made["radial"], made["ra_error1"] = made[names[0]], made[names[0]], made[names[4]]
    with pytest.raises(TableError) as caught:
        read_field(made)
    answer = re.search(
        r"Say which it is: columns=(\{.*?\}), units=(\{.*?\}) \(--columns (\S+) --units", str(caught.value)
    )
    columns, units = map(ast.literal_eval, answer.groups()[:2])
    assert answer[3] == ",".join(f"{role}={name}" for role, name in columns.items())
    after = read_field(made, columns=columns, units=units)
    np.testing.assert_allclose([after.lon, after.lat, *after.motion, *after.sigma],
                               [before.lon, before.lat, *before.motion, *before.sigma])  # fmt: skip


def test_rows_of_text_can_be_left_out_as_the_message_says(tmp_path):
    """The number of the row was that of the selection; and where it was left out, a number was called text."""
    made = table()
    made["name"] = [f"s{i}" for i in range(N)]
    texts = [str(x) for x in made["pmra"]]
    texts[5], texts[7], texts[9] = "bad", texts[7].replace("-", "\u2212"), f"{float(texts[9]):e}".replace("e", "D")
    made["pmra"] = texts
    path = tmp_path / "text.csv"
    made.write(path)
    for where in (None, "name != 's0'"):
        with pytest.raises(FieldError, match="'bad' in row 5, counted from 0") as caught:
            read_field(path, where=where)
    remedy = re.search(r"--where (.*)$", str(caught.value))[1]
    field = read_field(path, where=shlex.split(remedy)[0])
    kept = np.delete(np.arange(N), 5)
    np.testing.assert_allclose(field.motion[0], 1000 * np.asarray(table()["pmra"])[kept], rtol=1e-6)
