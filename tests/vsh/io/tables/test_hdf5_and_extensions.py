"""Files with several tables, one of which is named; HDF5 as pandas and vaex write it."""

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from conftest import random_field
from gaia_table import NAMES

from vsh import read_field
from vsh.io.tables import open_table
from vsh.tools.errors import TableError
from vsh.tools.files import digest

field = random_field(60, 3)
table = field.to_table()


@pytest.fixture
def several(tmp_path):
    hdus = [fits.PrimaryHDU(np.zeros((3, 3))), fits.table_to_hdu(Table({"obs": [1, 2], "flux": [3.0, 4.0]}))]
    hdus += [fits.table_to_hdu(table)]
    for hdu, name in zip(hdus[1:], ("LOG", "GAIA-CATALOG"), strict=True):
        hdu.header["EXTNAME"] = name
    fits.HDUList(hdus).writeto(tmp_path / "several.fits")
    return tmp_path / "several.fits"


@pytest.mark.parametrize("which", ["2", "GAIA-CATALOG", "gaia-catalog"])
def test_any_table_of_a_fits_file_is_read_by_number_or_name(several, which):
    read = read_field(f"{several}#{which}")
    np.testing.assert_allclose(read.motion, field.motion, rtol=1e-12)
    assert not any("the first was read" in str(note) for note in read.notes)
    assert digest(f"{several}#{which}") == digest(several)


def test_other_tables_are_named_where_the_first_lacks_a_column(several):
    with pytest.raises(TableError, match=r"2 tables, #1 \(LOG\), #2 \(GAIA-CATALOG\)"):
        read_field(several)
    for wrong in ("3", "NONE"):
        with pytest.raises(TableError, match="no such table"):
            open_table(f"{several}#{wrong}")


def test_frame_of_pandas(tmp_path):
    """As to_hdf writes it: blocks of numbers of one type, each with its names."""
    h5py = pytest.importorskip("h5py")
    blocks = [NAMES[:4], NAMES[4:]]
    with h5py.File(tmp_path / "frame.h5", "w") as file:
        group = file.create_group("quasars")
        group.attrs["pandas_type"] = "frame"
        group["axis0"], group["axis1"] = np.array(NAMES, "S"), np.arange(60)
        for k, names in enumerate(blocks):
            group[f"block{k}_items"] = np.array(names, "S")
            group[f"block{k}_values"] = np.stack([table[name] for name in names], axis=1)
    np.testing.assert_allclose(read_field(tmp_path / "frame.h5").motion, field.motion, rtol=1e-12)
    with h5py.File(tmp_path / "table.h5", "w") as file:
        group = file.create_group("quasars")
        group.attrs["pandas_type"] = "frame_table"
        group["table"] = np.zeros(5, [("index", int), ("values_block_0", float, (6,))])
    with pytest.raises(TableError, match="data_columns=True"):
        read_field(tmp_path / "table.h5")


def test_columns_of_vaex(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "vaex.hdf5", "w") as file:
        for name in NAMES:
            file[f"table/columns/{name}/data"] = np.asarray(table[name]) * (1000 if name.startswith("pm") else 1)
            if name.startswith("pm"):
                file[f"table/columns/{name}"].attrs["unit"] = "uas / yr"
        file["table/columns/redshift/data"] = np.full(60, 0.5)
        file["table/columns/redshift/mask"] = np.arange(60) < 10
    read = read_field(tmp_path / "vaex.hdf5")
    np.testing.assert_allclose(read.motion, field.motion, rtol=1e-12)
    assert np.isfinite(read.redshift).sum() == 50
