"""Every format that --columns format= names: told, by its ending, by its first bytes; and damaged."""

import gzip
import shutil

import numpy as np
import pytest
from astropy.table import Table
from conftest import real_catalogue
from gaia_table import NAMES, UNITS, table

from fit.commands.compare import main as compare
from fit.commands.fit import main
from vsh.io import catalogue, tables
from vsh.tools.errors import TableError, VshError


def made():
    """A table whose numbers every format keeps."""
    return table()[NAMES]


def readme(text, name):
    """The description that stands above the rows of a table in one file."""
    head, _, rows = text.rpartition("-" * 80 + "\n")
    return head.replace("table.dat", name) + "-" * 80 + "\n", rows


#: What astropy calls each, and what it has to be told beside it.
WRITERS = {
    "fits": {"format": "fits"}, "votable": {"format": "votable"}, "ecsv": {"format": "ascii.ecsv"},
    "csv": {"format": "ascii.csv"}, "parquet": {"format": "parquet"}, "mrt": {"format": "ascii.mrt"},
    "hdf5": {"format": "hdf5", "path": "sources", "serialize_meta": True}, "cds": {"format": "ascii.mrt"},
    "ascii": {"format": "ascii.basic"},
}  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", WRITERS)
def test_every_format(kind, tmp_path, capsys):
    wanted = catalogue.read_field(made())
    path = tmp_path / "mine.dat"
    made().write(path, **WRITERS[kind])
    units = UNITS if kind in ("ascii", "csv") else None
    field = catalogue.read_field(path, format=kind, units=units)
    np.testing.assert_allclose(field.motion, wanted.motion, rtol=1e-13)
    np.testing.assert_allclose(field.sigma, wanted.sigma, rtol=1e-13)
    assert not any("no unit" in note for note in field.notes)
    assert catalogue.parts(path, format=kind, units=units).sum(len) == len(wanted)
    assert main([str(path), "--lmax", "1", "--columns", f"format={kind}"]) == 0
    assert f": {len(wanted)} sources, " in capsys.readouterr().out
    if kind in ("cds", "ascii"):  # what has no mark of its own must be told
        return
    np.testing.assert_array_equal(catalogue.read_field(path, units=units).motion, field.motion)
    if kind in ("fits", "votable", "ecsv", "csv"):
        path.write_bytes(gzip.compress(path.read_bytes()))
        np.testing.assert_array_equal(catalogue.read_field(path, units=units).motion, field.motion)


def test_hdf5_by_columns(tmp_path):
    """A group with a dataset for each column, as other programs write them."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "c.h5"
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file[f"data/{name}"] = np.asarray(made()[name])
        file["data/source_id"] = np.arange(len(made())) + 2**60
    field = catalogue.read_field(path)
    assert field.name[3] == 2**60 + 3
    np.testing.assert_array_equal(field.motion, catalogue.read_field(made()).motion)
    with h5py.File(path, "a") as file:
        file["other/a"] = file["other/b"] = np.arange(3)
    with pytest.raises(TableError, match=r"c.h5 holds 2 tables \(data, other\): keep one in a file"):
        tables.open_table(path)


def test_tables_of_journals(tmp_path):
    """Sexagesimal positions, a gap, units that survive."""
    from astropy.coordinates import SkyCoord
    from astropy.table import MaskedColumn

    given = made()[:30]
    place = SkyCoord(given["ra"], given["dec"])
    mrt = Table({"place": place} | {name: given[name] for name in NAMES[2:]})  # astropy splits it into RAh … DEs
    mrt["z"] = MaskedColumn(np.linspace(0.1, 3, 30), mask=np.arange(30) == 4)
    mrt.write(tmp_path / "t.mrt", format="ascii.mrt")
    field = catalogue.read_field(tmp_path / "t.mrt")
    wanted = catalogue.read_field(given)
    np.testing.assert_allclose(field.lon, wanted.lon, atol=1e-12)
    np.testing.assert_allclose(field.lat, wanted.lat, atol=1e-12)
    assert np.isnan(field.redshift[4])
    # Between 0 and −1 degree the sign stands alone.
    assert (field.lat < 0).sum() == (wanted.lat < 0).sum()


def test_table_of_the_cds_with_its_readme(tmp_path):
    made().write(tmp_path / "whole.mrt", format="ascii.mrt")
    head, rows = readme((tmp_path / "whole.mrt").read_text(), "table1.dat")
    (tmp_path / "table1.dat").write_text(rows)
    with pytest.raises(TableError, match="does not describe its columns, and there is no file ReadMe beside it"):
        catalogue.read_field(tmp_path / "table1.dat", format="cds")
    (tmp_path / "ReadMe").write_text(head)
    for kind in ("cds", "mrt"):
        field = catalogue.read_field(tmp_path / "table1.dat", format=kind)
        np.testing.assert_array_equal(field.motion, catalogue.read_field(tmp_path / "whole.mrt").motion)
    (tmp_path / "ReadMe").write_text(head + "File: table1.dat\n")
    packed = tmp_path / "table1.dat.gz"
    packed.write_bytes(gzip.compress(rows.encode()))
    for path in (tmp_path / "table1.dat", packed):  # the ReadMe beside them says what they are
        np.testing.assert_array_equal(catalogue.read_field(path).motion, field.motion)


HIPPARCOS = """\
I/239              The Hipparcos and Tycho Catalogues (ESA 1997)
================================================================================
Byte-by-byte Description of file: hip_main.dat
--------------------------------------------------------------------------------
   Bytes Format Units   Label     Explanations
--------------------------------------------------------------------------------
   1-  6  I6    ---     HIP       Identifier
   8- 19  F12.8 deg     RAICRS    ? alpha, degrees (ICRS, Epoch=J1991.25)
  21- 32  F12.8 deg     DEICRS    ? delta, degrees (ICRS, Epoch=J1991.25)
  34- 41  F8.2  mas/yr  pmRA      ? Proper motion mu_alpha.cos(delta), ICRS
  43- 50  F8.2  mas/yr  pmDE      ? Proper motion mu_delta, ICRS
  52- 57  F6.2  mas/yr  e_pmRA    ? Standard error in pmRA
  59- 64  F6.2  mas/yr  e_pmDE    ? Standard error in pmDE
  66- 70  F5.2  ---     pmDE:pmRA [-1/1]? Correlation
--------------------------------------------------------------------------------
"""


def test_hipparcos_beside_its_readme(tmp_path):
    """The row whose position is blank is left out and counted."""
    (tmp_path / "ReadMe").write_text(HIPPARCOS)
    row = "{:6d} {:12.8f} {:12.8f} {:8.2f} {:8.2f} {:6.2f} {:6.2f} {:5.2f}\n"
    rows = [row.format(i, 10.0 * i, -5.0 * i, i, -i, 1.05, 0.8, 0.12) for i in (1, 2, 4)]
    rows.insert(2, f"{3:6d}{'':64}\n")
    (tmp_path / "hip_main.dat").write_text("".join(rows))
    field = catalogue.read_field(tmp_path / "hip_main.dat")
    np.testing.assert_allclose(np.degrees(field.lon), [10, 20, 40])
    np.testing.assert_allclose(field.motion, [[1000, 2000, 4000], [-1000, -2000, -4000]])
    np.testing.assert_allclose(field.rho, 0.12)
    assert "left out 1 of 4 rows: position missing: 1" in field.notes


def test_lists_of_the_iers(capsys):
    path = str(real_catalogue("icrf3sx.txt"))
    opened = tables.open_table(path, "icrf")
    assert opened.names == ("icrf", "iers", "defining", "ra", "dec", "ra_error", "dec_error", "ra_dec_corr")
    listed = catalogue.read_positions(path)
    chosen = catalogue.read_positions(path, "icrf", where='defining == "D"', format="icrf")
    assert len(chosen) == 303 == listed.defining.sum()
    np.testing.assert_array_equal(chosen.name, listed.name[listed.defining])
    np.testing.assert_allclose(chosen.lon, listed.lon[listed.defining], rtol=1e-15)
    words = [path, str(real_catalogue("icrf2-all.txt")), "--lmax", "1", "--columns", "icrf", "--columns", "format=icrf"]
    assert compare([*words, "--where", 'defining == "D"']) == 0
    assert "sources" in capsys.readouterr().out
    assert main([path, "--columns", "format=icrf"]) == 1
    assert "no column 'pmra'" in capsys.readouterr().err


def test_first_bytes_of_nothing_that_is_known(tmp_path):
    (tmp_path / "notes.txt").write_bytes(b"dear diary,\0\n")
    with pytest.raises(
        TableError, match="notes.txt: unrecognised format.*endings.* Name it: --columns format=NAME, of"
    ):
        tables.open_table(tmp_path / "notes.txt")
    for place in (tmp_path / "notes.txt", "https://host/t.fits"):
        with pytest.raises(TableError, match="no format is called 'excel'"):
            tables.open_table(place, "excel")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["hdf5", "mrt", "cds", "ascii"])
def test_damaged_files(kind, tmp_path):
    """Cut short, or with bytes changed: an error of ours that names the file, or rows that are counted.

    HDF5 is only cut short: some changed bytes make its own library end the process (docs/troubleshooting.md).
    """
    whole = tmp_path / "whole.dat"
    made().write(whole, **WRITERS[kind])
    content = whole.read_bytes()
    rng = np.random.default_rng(1)
    seen = 0
    for k in range(0, 40, 2) if kind == "hdf5" else range(40):
        broken = bytearray(content[: len(content) if k % 2 else rng.integers(1, len(content))])
        for at in rng.integers(0, len(broken), 20 * (k % 2)):
            broken[at] = rng.integers(256)
        path = tmp_path / "broken.dat"
        path.write_bytes(broken)
        try:
            catalogue.read_field(path, format=kind, units=UNITS, on_bad="drop")
        except VshError:
            seen += 1
    assert seen > 5


def test_folder_in_a_format_that_is_told(tmp_path):
    for k in range(2):
        made()[k::2].write(tmp_path / f"part{k}.dat", format="ascii.basic")
    assert len(catalogue.read_field(tmp_path, format="ascii", units=UNITS)) == len(made())
    shutil.rmtree(tmp_path)
    with pytest.raises(TableError, match="no such file"):
        tables.open_table(tmp_path, "ascii")
