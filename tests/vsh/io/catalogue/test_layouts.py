"""The layouts in which tables of this field are handed round, made here as they are published, and read."""

import bz2
import gzip
import io
import lzma
import re

import numpy as np
import pytest
from astropy.table import Table
from gaia_table import NAMES, table

from vsh.io import tables
from vsh.io.catalogue import read_field, read_icrf, read_positions, read_sources
from vsh.tools.errors import FieldError, TableError, VshError
from vsh.tools.notes import DOUBT, has_code

UNITS = ["deg", "deg", "mas/yr", "mas/yr", "mas/yr", "mas/yr"]
VIZIER = ["RA_ICRS", "DE_ICRS", "pmRA", "pmDE", "e_pmRA", "e_pmDE"]


def rows():
    """Numbers that every layout keeps."""
    return np.round(np.stack([np.asarray(table()[name], float) for name in NAMES], 1), 6)


def delimited(names=NAMES, between=",", above="", below="", units=None, dashes=False, comma=False, head=True):
    lines = [between.join(names)] if head else []
    lines += [between.join(units)] if units else []
    lines += [between.join("-" * len(name) for name in names)] if dashes else []
    body = [between.join(f"{value:.6f}" for value in row) for row in rows()]
    body = [line.replace(".", ",") for line in body] if comma else body
    return above + "\n".join([*lines, *body]) + "\n" + below


VIZIER_HEAD = """#
#   VizieR Astronomical Server vizier.cds.unistra.fr
#    Date: 2026-11-20T10:00:00 [V7.4]
#Coosys\tJ2000:\teq_FK5 J2000
#INFO\t-ref=VIZ6740
#RESOURCE=yCat_1355
#Name: I/355
#Column\tRA_ICRS\t(F15.11)\tRight ascension  [ucd=pos.eq.ra;meta.main]

"""


def fixed(above=VIZIER_HEAD, rule=True):
    """VizieR's "ascii table": a rule of dashes gives the columns, or blanks alone."""
    width = [12, 12, 11, 11, 9, 9]
    cells = [VIZIER, *([[f"({unit})" for unit in UNITS], ["-" * w for w in width]] if rule else [])]
    cells += [[f"{value:.6f}" for value in row] for row in rows()]
    return above + "\n".join(" ".join(cell.rjust(w) for cell, w in zip(row, width)) for row in cells) + "\n"


def mrt(mark=""):
    text = io.StringIO()
    Table(rows(), names=NAMES, units=UNITS).write(text, format="ascii.mrt")
    return "".join(f"{mark}{line}\n" for line in text.getvalue().splitlines())


def numbered(mark=""):
    """Rows behind their numbers, which have no name; all names in quotes, or none."""
    head, *body = CSV.splitlines()
    quoted = ",".join(f"{mark}{name}{mark}" for name in ("", *head.split(",")))
    return "\n".join([quoted, *(f"{mark}{k}{mark},{line}" for k, line in enumerate(body))]) + "\n"


CSV = delimited()
ROWS = CSV.partition("\n")[2]
LAYOUTS = {
    "vizier with tabs": ("v.tsv", delimited(VIZIER, "\t", VIZIER_HEAD, "\n#END#\n", UNITS, dashes=True)),
    "vizier with semicolons": ("v.txt", delimited(VIZIER, ";", VIZIER_HEAD, "#END#\n", UNITS, dashes=True)),
    "vizier with bars": ("v.dat", delimited(VIZIER, "|", VIZIER_HEAD, "", UNITS, dashes=True)),
    "vizier without comments": ("v.tsv", delimited(VIZIER, ";", "", "", UNITS, dashes=True)),
    "vizier without dashes": ("v.tsv", delimited(VIZIER, "\t", VIZIER_HEAD, "", UNITS)),
    "vizier's number of a table alone": ("v.txt", delimited(VIZIER, ";", "#Table;J/A+A/1\n", "", UNITS, dashes=True)),
    "vizier ascii table": ("v.txt", fixed()),
    "vizier ascii table, rules around": ("v.txt", fixed("-" * 70 + "\n")),
    "fixed width without a rule": ("v.txt", fixed("", rule=False)),
    "blanks after commas": ("a.csv", CSV.replace(",", " , ")),
    "semicolons": ("a.csv", CSV.replace(",", ";")),
    "semicolons and decimal commas": ("a.csv", delimited(between=";", comma=True)),
    "tabs": ("a.csv", CSV.replace(",", "\t")),
    "blanks": ("a.txt", CSV.replace(",", "  ")),
    "behind a #": ("a.txt", "# " + CSV.replace(",", " ")),
    "commas behind a #": ("a.csv", "# made by hand\n#" + CSV),
    "a heading of several lines": ("a.txt", "".join(f"#  {'  '.join(words)}\n" for words in (
        VIZIER, [f"({unit})" for unit in UNITS])) + "#-----\n" + fixed("", rule=False).partition("\n")[2]),
    "headings of groups": ("a.csv", "Position,,Motion,,Errors,\n" + CSV),
    "a title": ("a.csv", "Table 3. Proper motions of quasars\n" + CSV),
    "a line before the names": ("a.csv", "; version 2\n" + CSV),
    "an unnamed first column": ("a.csv", numbered()),
    "a row number of R": ("a.csv", numbered('"')),
    "names of R": ("a.csv", delimited(["ra", "dec", "pmRA", "pmDE", "pmRA_error", "pmDE_error"])),
    "names of R, with X_": ("a.csv", delimited(["X_RAJ2000", "X_DEJ2000", *VIZIER[2:]])),
    "a row of units": ("a.csv", delimited(units=UNITS)),
    "bom and crlf": ("a.csv", "\ufeff" + CSV.replace("\n", "\r\n")),
    "names between ; over rows between blanks": ("a.txt", ";".join(NAMES) + "\n" + ROWS.replace(",", "   ")),
    "mrt behind #": ("a.txt", mrt("# ")),
    "units in names": ("a.csv", delimited([
        "RA (deg)", "Dec (deg)", "pmra [mas/yr]", "pmdec_mas_yr", "pmra_error(mas/yr)", "pmdec_error_masyr"])),
    "upper case": ("a.csv", delimited([name.upper() for name in NAMES])),
    "errors called err": ("a.csv", delimited([*NAMES[:4], "pmra_err", "pmdec_err"], units=UNITS)),
}  # fmt: skip
PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_same_numbers(name, tmp_path):
    file, text = LAYOUTS[name]
    path = tmp_path / file
    path.write_bytes(text.encode())
    field = read_field(path)
    wanted = rows()
    np.testing.assert_allclose(np.degrees(field.lon), wanted[:, 0], rtol=1e-12)
    np.testing.assert_allclose(np.degrees(field.lat), wanted[:, 1], rtol=1e-12)
    np.testing.assert_allclose(field.motion, 1000 * wanted[:, 2:4].T, rtol=1e-12)
    np.testing.assert_allclose(field.sigma, 1000 * wanted[:, 4:].T, rtol=1e-12)
    for ending, pack in PACKERS.items():
        packed = tmp_path / (file + ending)
        packed.write_bytes(pack(text.encode()))
        np.testing.assert_array_equal(read_field(packed).motion, field.motion)


@pytest.mark.filterwarnings("ignore:warning. half of the errors are below")
@pytest.mark.parametrize("none", ["--", "---"])
def test_row_of_units_counts(none, tmp_path):
    """Other units than Gaia's, and dashes where there is none."""
    (tmp_path / "a.csv").write_text(delimited(units=[none, none, *["uas/yr"] * 4]))
    field = read_field(tmp_path / "a.csv")
    np.testing.assert_allclose(field.motion, rows()[:, 2:4].T, rtol=1e-12)
    np.testing.assert_allclose(np.degrees(field.lon), rows()[:, 0], rtol=1e-12)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["vizier with tabs", "vizier ascii table", "blanks after commas", "behind a #"])
def test_damaged_line_is_named(name, tmp_path):
    file, text = LAYOUTS[name]
    lines = text.splitlines()
    lines[-5] = lines[-5][: len(lines[-5]) // 2] + "x" + lines[-5][len(lines[-5]) // 2 :]
    (tmp_path / file).write_text("\n".join(lines))
    with pytest.raises(VshError, match="holds text|damaged"):
        read_field(tmp_path / file)
    lines[-5] = lines[-5].replace("\t", "", 1).replace(",", "", 1).replace(" ", "", 3)
    (tmp_path / file).write_text("\n".join(lines))
    with pytest.raises(TableError, match=f"line {len(lines) - 4} is damaged"):
        read_field(tmp_path / file)


def test_table_without_names(tmp_path):
    path = tmp_path / "bare.txt"
    path.write_text(delimited(head=False, between=" "))
    with pytest.raises(TableError, match="as there are values, so columns are called by their numbers"):
        read_field(path)
    columns = {name: f"col{k + 1}" for k, name in enumerate(NAMES)}
    with pytest.raises(TableError, match="columns 'col3', .* have no unit: say which.*--units col3=mas/yr,col4=mas/yr"):
        read_field(path, columns)
    field = read_field(path, columns, {f"col{k + 1}": unit for k, unit in enumerate(UNITS)})
    np.testing.assert_allclose(field.motion, 1000 * rows()[:, 2:4].T, rtol=1e-12)


def test_sexagesimal_positions_are_hours_and_degrees(tmp_path):
    path = tmp_path / "s.tsv"
    path.write_text(
        'RAJ2000\tDEJ2000\tpmRA\tpmDE\te_pmRA\te_pmDE\n"h:m:s"\t"d:m:s"\tmas/yr\tmas/yr\tmas/yr\tmas/yr\n'
        "-----------\t-----------\t---\t---\t---\t---\n"
        "12 30 00.00\t-00 30 36.0\t1.0\t2.0\t0.1\t0.2\n00 00 01.00\t+89 59 59.9\t1.5\t2.5\t0.1\t0.2\n"
    )
    field = read_field(path)
    np.testing.assert_allclose(np.degrees(field.lon), [187.5, 15 / 3600])
    np.testing.assert_allclose(np.degrees(field.lat), [-0.51, 90 - 0.1 / 3600])


def test_errors_of_two_sides_and_ellipses():
    base = {"ra": [10.0, 20.0], "dec": [1.0, 2.0], "pmra": [0.1, 0.2], "pmdec": [0.3, 0.4]}
    sided = base | {"pmra_em": [0.1, 0.3], "pmra_ep": [0.2, 0.1], "pmdec_em": [0.1, 0.1], "pmdec_ep": [0.1, 0.4]}
    field = read_field(sided)
    np.testing.assert_allclose(field.sigma, [[200, 300], [100, 400]])
    assert any("the larger is taken: pmra_error, pmdec_error" in note for note in field.notes)
    ellipse = base | {"pm_err_maj": [0.2, 0.2], "pm_err_min": [0.1, 0.1], "pm_err_angle": [90.0, 45.0]}
    field = read_field(ellipse)
    np.testing.assert_allclose(field.sigma[:, 0], [200, 100])
    np.testing.assert_allclose(field.rho, [0, 0.6], atol=1e-12)
    # The major axis lies where the covariance is largest: north-east.
    assert field.sigma[0, 1] == pytest.approx(np.sqrt((0.2**2 + 0.1**2) / 2) * 1000)


def test_correlation_of_another_name_is_named():
    made = {name: column for name, column in zip(NAMES, rows().T)} | {"rho(pmRA,pmDE)": np.full(len(rows()), 0.5)}
    with pytest.warns(match=r"the table has rho\(pmRA,pmDE\): if it is that, say --columns 'pmra_pmdec_corr=rho"):
        read_field(made)


POSITIONS = (
    ("0002-478", 1.1485148, -47.605445667778, 0.00001359, 0.0002139, 0.383),
    ("2357-326", 0.08499990, -32.35034264, 0.00000804, 0.0002624, -0.0602),
    ("3C273B", 187.27791559, 2.0523883, 0.0000061, 0.0001, -0.013),
)


def sexagesimal(lon, lat):
    h = lon / 15
    m, s = divmod((h % 1) * 3600, 60)
    d = abs(lat)
    dm, ds = divmod((d % 1) * 3600, 60)
    return (f"{int(h):02d}", f"{int(m):02d}", f"{s:011.8f}"), ("-" if lat < 0 else "+", f"{int(d):02d}", f"{int(dm):02d}", f"{ds:010.7f}")  # fmt: skip


def listed(kind):
    """A list of radio sources as it is published."""
    lines = {
        "crf": ["# IVS name, IERS name, RA, Dec, errors [s, arcsec], correlation, MJD mean first last, sessions, obs"],
        "globl": ["# Solution gsf2020a of globl"],
        "getpar": ["# GETPAR_SOU format version 1.0  of 2001.05.25"],
        "rfc": ["# VLBI SOURCE POSITION CATALOGUE  Format version of 2024.10.14", "#"],
        "vievs": ["* VieVS", "* name RA Dec epoch velocity"],
        "icrf with flags": ["heading", ""],
    }[kind]
    for name, lon, lat, east, north, rho in POSITIONS:
        (h, m, s), (sign, d, dm, ds) = sexagesimal(lon, lat)
        mas = east * 15000, north * 1000
        lines.append({
            "crf": f"{name:8} {name:8} {h} {m} {s} {sign}{d} {dm} {ds} {east:.8f} {north:.7f} {rho:7.4f} 55000.0 45000.0 58000.0 10 100 0 Y",
            "globl": f"   {name:8}    {h} {m} {s}   {sign}{d} {dm} {ds}   {east:.8f}  {north:.7f}  {f'{rho:.4f}'.replace('0.', '.'):>7} 55000.0 45000.0 58000.0 10 100",
            "getpar": f"SOU_GCO:  {name:8}  R: {h}_{m}_{s} -+ {mas[0]:10.4f}  D: {sign}{d}_{dm}_{ds} -+ {mas[1]:10.4f}  C: {rho:6.3f} Obs_used: 100 Obs_tot: 200",
            "rfc": f"RFC J0000+0000  {name:8} {h} {m} {s} {sign}{d} {dm} {ds} {mas[0]:8.4f} {mas[1]:8.4f} {rho:7.4f}",
            "vievs": f"{name:8} {h} {m} {s} {sign}{d} {dm} {ds} 2000.0 0.0 GSFC 1",
            "icrf with flags": f"ICRF J000000.0+000000  {name:8}  D V {h} {m} {s} {sign}{d} {dm} {ds} {east:.8f} {north:.7f} {rho:7.4f}  55000.0",
        }[kind])  # fmt: skip
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", ["crf", "globl", "getpar", "rfc", "icrf with flags"])
def test_lists_of_vlbi(kind, tmp_path):
    path = tmp_path / "list.txt"
    path.write_text(listed(kind))
    positions = read_positions(path)
    for k, (name, lon, lat, east, north, rho) in enumerate(POSITIONS):
        assert positions.name[k] == name
        np.testing.assert_allclose(np.degrees([positions.lon[k], positions.lat[k]]), [lon, lat], atol=1e-9)
        size = [15e6 * east * np.cos(np.radians(lat)), 1e6 * north]
        np.testing.assert_allclose(positions.sigma[:, k], size, rtol=2e-3)
        assert positions.rho[k] == pytest.approx(rho, abs=6e-4)
    assert any("do not include cos δ and were multiplied by it" in note for note in positions.notes)
    if kind == "icrf with flags":
        assert positions.defining.all()


@pytest.mark.parametrize("kind", ["crf", "icrf with flags"])
def test_list_with_blank_errors(kind, tmp_path):
    """OCARS has sources without errors, and others without a correlation: numbers behind the blanks are neither."""
    lines = (listed(kind) + listed(kind).splitlines()[-1]).splitlines()
    (_, _, _, *error), (*_, rho) = POSITIONS[1], POSITIONS[2]
    blank = f"{error[0]:.8f} {error[1]:.7f} {error[2]:7.4f}"
    lines[-3] = lines[-3].replace(blank, " " * len(blank))
    lines[-2] = lines[-2].replace(f"{rho:7.4f}", " " * 7)
    path = tmp_path / "list.txt"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FieldError, match=r"1 of 4 rows cannot be used: ra_error.*\(row 1\)"):
        read_icrf(path, "iers")
    assert len(read_icrf(path, "iers", on_bad="drop")) == 3
    positions = read_positions(path, on_bad="drop")
    assert positions.name.tolist() == ["0002-478", "3C273B", "3C273B"]
    np.testing.assert_allclose(positions.rho, [0.383, 0, rho], atol=1e-6)
    np.testing.assert_allclose(positions.sigma[1], [213.9, 100, 100])
    # A source that lacks three numbers is one source.
    assert any("left out 1 of 4 rows" in note for note in positions.notes)
    assert any("1 sources have errors and no correlation" in note for note in positions.notes)


def test_redshifts_and_types_where_a_heading_says_that_they_stand(tmp_path):
    """OCARS: the first redshift that is known, and none that is a limit (flags c and d)."""
    told = (
        "0.5000a 0.6000  AQ",
        "        0.6000  AL",
        "0.5000c 0.6000  G ",
        "                R ",
        "0.5000d           ",
    )
    start = "0002-478 J0004-4736 00 04 35.65550384 -47 36 19.6037899 0.00001383 0.0002139 0.3830  "
    places = ((len(start) + 1, 6, "redshift from NED"), (len(start) + 9, 6, "redshift from SIMBAD"),
              (len(start) + 17, 2, "object primary type:"))  # fmt: skip
    heading = "".join(f"# {begin:3} - {begin + width - 1:3}  {words}\n" for begin, width, words in places)
    path = tmp_path / "list.txt"
    path.write_text(heading + "".join(f"{start}{text}\n" for text in told))
    table = tables.read_table(path)
    np.testing.assert_array_equal(table["redshift"], [0.5, 0.6, 0.6, np.nan, np.nan])
    assert table["type"].tolist() == ["AQ", "AL", "G", "R", ""]
    np.testing.assert_array_equal(read_sources(path, sigma=1.0).redshift, table["redshift"])
    path.write_text("".join(f"{start}{text}\n" for text in told))
    assert "redshift" not in tables.read_table(path).colnames


def test_columns_that_a_header_numbers(tmp_path):
    """The .cat of the IVS analysis centre in Paris; without cos δ its errors would be others, and are not taken."""
    meanings = ("IVS designation", "IERS designation", "Right ascension", "Declination",
                "Formal uncertainty of the right ascension (*cos(Dec))", "Formal uncertainty of the declination",
                "Correlation between right ascension and declination")  # fmt: skip
    units = ("--", "--", "deg", "deg", "mas", "mas", "--")
    header = "".join(f"# {k:4}  {unit:8} {words}\n" for k, (unit, words) in enumerate(zip(units, meanings), 1))
    path = tmp_path / "solution.cat"
    rows = "2357-326  2357-326 0.0849999277 -32.3503427004 0.0754 0.2096 +0.0460\n" * 2
    path.write_text("# A solution\n# Columns  Units   Meaning\n" + header + "# Created 04/08/2018\n#\n" + rows)
    positions = read_positions(path)
    np.testing.assert_allclose(np.degrees([positions.lon[0], positions.lat[0]]), [0.0849999277, -32.3503427004])
    np.testing.assert_allclose(positions.sigma[:, 0], [75.4, 209.6])
    assert positions.rho[0] == 0.046
    assert positions.name[0] == "2357-326"
    path.write_text(path.read_text().replace(" (*cos(Dec))", ""))
    with pytest.raises(TableError, match="no column 'ra_error'"):
        read_positions(path)


def test_names_behind_a_mark_above_rows_with_few_numbers(tmp_path):
    """The list of the EVN: two angles among eight fields; its first source became the names."""
    path = tmp_path / "evn.csv"
    row = "0004+139,,, ,Q , 00:06:57.681,  14:15:53.90, EVN_list\n"
    path.write_text("#IAUname,Alias1,Alias2,redshift,Q/B/G,RA2000,Dec2000,fromfile\n" + row * 3)
    positions = read_positions(path, {"ra": "RA2000", "dec": "Dec2000", "name": "IAUname"}, sigma=100)
    assert len(positions) == 3
    np.testing.assert_allclose(np.degrees([positions.lon[0], positions.lat[0]]), [1.7403375, 14.2649722], atol=1e-6)


def test_positions_are_checked_as_those_of_motions_are():
    """Radians and hours were read as degrees where positions alone are compared; VizieR's names were not known."""
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 360, 50), rng.uniform(-80, 80, 50)
    errors = {"ra_error": np.full(50, 0.1), "dec_error": np.full(50, 0.1)}
    with pytest.raises(FieldError, match="radians.*--units ra=rad,dec=rad"):
        read_positions({"ra": np.radians(lon), "dec": np.radians(lat), **errors})
    turned = {"ra": np.radians(lon), "dec": np.radians(lat), **errors}
    found = read_positions(turned, units={"ra": "rad", "dec": "rad"})
    np.testing.assert_allclose(np.degrees([found.lon, found.lat]), [lon, lat])
    with pytest.raises(TableError, match="units: no column 'alpha'"):
        read_positions(turned, units={"alpha": "rad"})
    with pytest.raises(FieldError, match="is ra in hours"):
        read_positions({"ra": lon / 15, "dec": lat, **errors})
    vizier = {"RA_ICRS": lon, "DE_ICRS": lat, "e_RA_ICRS": errors["ra_error"], "e_DE_ICRS": errors["dec_error"]}
    np.testing.assert_allclose(np.degrees(read_positions(vizier).lon), lon)


def test_list_without_errors(tmp_path):
    path = tmp_path / "vievsCrf.txt"
    path.write_text(listed("vievs"))
    for read in (read_positions, read_icrf):
        with pytest.raises(TableError, match="no column 'ra_error'.*one error for all: sigma=200"):
            read(path)
    assert (read_positions(path, sigma=100.0).sigma == 100).all()


def test_files_that_are_no_list_of_positions(tmp_path):
    path = tmp_path / "list.crf"
    path.write_text("no\nsources\n")
    with pytest.raises(TableError, match="no line with a position in hours and degrees"):
        read_positions(path)
    lines = [line for line in listed("rfc").splitlines() if not line.startswith("#")]
    path.write_text("\n".join(re.sub(r"\S+ +\S+ +(\S+)$", r"9e4 9e4 \1", line) for line in lines))
    with pytest.raises(TableError, match="arcsec in the median if in mas: another unit"):
        read_positions(path)


def test_errors_that_cannot_be_in_seconds_are_in_mas(tmp_path):
    """Of a list of the RFC without its header: 0.2 is an error in mas, not in arcsec."""
    path = tmp_path / "list.crf"
    path.write_text(listed("rfc"))
    told = read_positions(path)
    lines = [line for line in listed("rfc").splitlines() if not line.startswith("#")]
    path.write_text("\n".join(lines).replace("RFC J", "C J"))
    guessed = read_positions(path)
    np.testing.assert_array_equal(guessed.sigma, told.sigma)
    assert any(has_code(note, DOUBT) for note in guessed.notes)
    assert not any(has_code(note, DOUBT) for note in told.notes)
    path.write_text("# noise of 0.03 (mas) is in the errors, which are in s and arcsec\n" + listed("crf"))
    with_words = read_positions(path)
    path.write_text(listed("crf"))
    np.testing.assert_array_equal(with_words.sigma, read_positions(path).sigma)


def sinex(kind="COVA"):
    """Three sources with a correlation of −0.3 each, as a solution of the IVS."""
    lines = ["%=SNX 2.02 IVS 21:050:00000 IVS 79:215:00000 21:001:00000 R 00006 2 S", "+SOURCE/ID"]
    estimates, matrix = [], []
    for k, (name, lon, lat, *_) in enumerate(POSITIONS, 1):
        lines.append(f" {k:04d} {name:8} J{k:06d}.0+000000")
        for j, (what, value, error) in enumerate((("RA", lon, 5e-10), ("DE", lat, 8e-10))):
            index = 2 * k - 1 + j
            estimates.append(
                f" {index:5} RS_{what}  {k:04d} -- ---- 15:001:00000 rad  2 {np.radians(value):.14E} {error:.5E}"
            )
            rho = -0.3 * (5e-10 * 8e-10 if kind == "COVA" else 1.0)
            own = error**2 if kind == "COVA" else 1.0
            matrix.append(f" {index:5} {index - j:5} " + (f"{own:.10E}" if not j else f"{rho:.10E} {own:.10E}"))
    lines += ["-SOURCE/ID", "+SOLUTION/ESTIMATE", "*INDEX TYPE", *estimates, "-SOLUTION/ESTIMATE"]
    return "\n".join([*lines, f"+SOLUTION/MATRIX_ESTIMATE L {kind}", *matrix, "-SOLUTION", "%ENDSNX"]) + "\n"


@pytest.mark.parametrize("kind", ["COVA", "CORR"])
@pytest.mark.parametrize("name", ["solution.snx", "solution"])
def test_sinex(tmp_path, kind, name):
    (tmp_path / name).write_text(sinex(kind))
    read = read_positions(tmp_path / name)
    assert read.name.tolist() == [row[0] for row in POSITIONS]
    np.testing.assert_allclose(read.lon, np.radians([row[1] for row in POSITIONS]), rtol=1e-12)
    np.testing.assert_allclose(read.sigma[1], np.degrees(8e-10) * 3.6e9)
    np.testing.assert_allclose(read.sigma[0], np.degrees(5e-10) * 3.6e9 * np.cos(read.lat))
    np.testing.assert_allclose(read.rho, -0.3)
    (tmp_path / name).write_text(sinex(kind).replace("E-10", "D-10"))
    np.testing.assert_allclose(read_positions(tmp_path / name).rho, -0.3)
    n = len(POSITIONS)
    for part in (read, read_positions(tmp_path / name, where="ra > 0")[np.ones(n, bool)]):
        own = np.zeros((2 * n, 2 * n))
        own[np.diag_indices(2 * n)] = (part.sigma**2).ravel()
        own[np.arange(n), n + np.arange(n)] = own[n + np.arange(n), np.arange(n)] = part.rho * part.sigma.prod(0)
        np.testing.assert_allclose(part.covariance, own, rtol=1e-5)
    np.testing.assert_array_equal(read[[2, 0]].covariance[0], read.covariance[2][[2, 0, n + 2, n]])


def test_sinex_matrix_that_is_cut_absent_or_inverted(tmp_path):
    """An element on the diagonal tells that the matrix is whole; INFO is the inverse; errors may stand there alone."""
    path, lines = tmp_path / "a.snx", sinex().splitlines()
    start = lines.index("+SOLUTION/MATRIX_ESTIMATE L COVA")
    for end in (start - 2, start + 4):  # within the estimates, and within the matrix
        path.write_text("\n".join(lines[:end]) + "\n")
        with pytest.raises(TableError, match="is cut: its last line"):
            read_positions(path)
    path.write_text("\n".join(lines[: start + 4]) + "\n%ENDSNX\n")
    with pytest.raises(TableError, match="lacks 3 of 6 diagonal elements"):
        read_positions(path)
    path.write_text("\n".join(lines[:start]) + "\n%ENDSNX\n")
    read = read_positions(path)
    assert read.covariance is None
    assert any("no covariance between sources" in str(note) for note in read.notes)
    path.write_text(sinex())
    whole = read_positions(path)
    path.write_text(re.sub(r" [58]\.00000E-10", " 0.00000E+00", sinex()))
    np.testing.assert_allclose(read_positions(path).sigma, whole.sigma)
    places = [place + k for k in range(len(POSITIONS)) for place in (0, len(POSITIONS))]  # RA and DE of each in turn
    scale = 1e-3 / (np.degrees(3.6e6) * np.r_[np.cos(whole.lat), np.ones(len(whole))])
    inverse = np.linalg.inv((whole.covariance * scale * scale[:, None])[np.ix_(places, places)])
    rows = [f" {i + 1} {j + 1} {inverse[i, j]:.14E}" for i in range(len(places)) for j in range(i, len(places))]
    path.write_text("\n".join([*lines[:start], "+SOLUTION/MATRIX_ESTIMATE U INFO", *rows, "%ENDSNX"]) + "\n")
    np.testing.assert_allclose(read_positions(path).covariance, whole.covariance, rtol=1e-6, atol=1e-9)


def test_sinex_without_sources_is_told(tmp_path):
    path = tmp_path / "stations.snx"
    path.write_text("%=SNX 2.02\n+SOLUTION/ESTIMATE\n     1 STAX   0001  A    1 00:001:00000 m    2 1.0 1.0\n%ENDSNX\n")
    with pytest.raises(TableError, match="no solution of positions .* in SINEX: it has no block 'SOURCE/ID'"):
        read_positions(path)
    path.write_text(sinex().replace("RS_RA", "RS_XX"))
    with pytest.raises(TableError, match="no solution of positions"):
        read_positions(path)


def test_list_of_vlba_calibrators(tmp_path):
    """A band stands where others have a correlation, and errors are in mas; one that is rounded to zero is missing."""
    path = tmp_path / "calibrators.txt"
    path.write_text(
        "#      N A M E                RA            DEC          RAE  DECE  B1  Sh    Lg\n"
        "J0000-3221  2357-326  00 00 20.399952  -32 21 01.23354   0.28  0.62 -  0.50  0.34\n"
        "J0004-4736  0002-478  00 04 35.655504  -47 36 19.60373   0.07  0.12 X  0.32  0.29\n"
        "J0121+1149  0119+115  01 21 41.595043  +11 49 50.41311   0.00  0.01 -  1.20  0.90\n"
    )
    with pytest.raises(FieldError, match="1 of 3 rows cannot be used: ra_error"):
        read_positions(path)
    read = read_positions(path, on_bad="drop")
    np.testing.assert_allclose(read.sigma[1], [620.0, 120.0])
    np.testing.assert_allclose(read.sigma[0, 0], 280.0 * np.cos(read.lat[0]))
    assert (read.rho == 0).all()


def test_list_without_usable_errors_has_none(tmp_path):
    """AT20G has fluxes where others have errors, JVAS nothing: both are read with one error for all."""
    path = tmp_path / "list.crf"
    lines = [line for line in listed("rfc").splitlines() if not line.startswith("#")]
    path.write_text("\n".join(re.sub(r"\S+ +\S+ +(\S+)$", "-3.2 f 0", line) for line in lines))
    with pytest.raises(TableError, match="sigma="):
        read_positions(path)
    assert (read_positions(path, sigma=50.0).sigma == 50).all()


def test_zstandard(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    path = tmp_path / "a.csv.zst"
    with pyarrow.output_stream(str(path), compression="zstd") as stream:
        stream.write(CSV.encode())
    np.testing.assert_allclose(read_field(path).motion, 1000 * rows()[:, 2:4].T, rtol=1e-12)
    assert tables.format_of("a.csv.zst", tables._open.READ) == "ascii.csv"
    with pytest.raises(TableError, match="unrecognised format"):
        tables.write_table(table(), tmp_path / "b.csv.zst")
