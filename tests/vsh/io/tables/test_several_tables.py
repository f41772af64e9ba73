"""Several tables in a file or a folder: joined, or refused, and none of them lost without a word."""

import numpy as np
import pytest
from astropy.io import fits
from astropy.io.votable import from_table
from astropy.io.votable.tree import VOTableFile
from astropy.table import vstack
from gaia_table import NAMES

import sim
from vsh.io import tables
from vsh.io.catalogue import read_field
from vsh.io.epochs import epoch_files, read_observations
from vsh.tools.errors import TableError


@pytest.fixture(scope="module")
def transits():
    return sim.epochs(sim.quasars(4, 1), sim.spin((0, 0, 0)), 2)


def by_source(table):
    return [table[table["source_id"] == name] for name in np.unique(table["source_id"])]


def votable_of(parts, path):
    document = VOTableFile()
    for part in parts:
        document.resources.append(from_table(part).resources[0])
    document.to_xml(str(path))


def test_votable_with_a_table_for_each_source(transits, tmp_path):
    """The first alone was read: 3 of 60 sources of an archive's combined file."""
    parts = by_source(transits)
    votable_of(parts, tmp_path / "e.xml")
    found, whole = read_observations(tmp_path / "e.xml"), read_observations(vstack(parts, metadata_conflicts="silent"))
    assert len(found.lon) == 4
    np.testing.assert_allclose(found.position, whole.position)
    assert "holds 4 tables; 4 with the columns of the first were read" in str(found.notes)
    parts[1]["scan_pos_angle"].unit = "rad"
    votable_of(parts, tmp_path / "u.xml")
    with pytest.raises(TableError, match="holds tables with scan_pos_angle in deg and in rad"):
        read_observations(tmp_path / "u.xml")


def test_fits_with_a_table_for_each_source_is_refused(transits, tmp_path):
    hdus = [fits.PrimaryHDU(), *(fits.table_to_hdu(part) for part in by_source(transits))]
    fits.HDUList(hdus).writeto(tmp_path / "e.fits")
    with pytest.raises(TableError, match="holds 4 tables with the same columns"):
        tables.open_table(tmp_path / "e.fits")


def test_folder_of_epochs_has_what_commands_leave_there(transits, tmp_path):
    transits.write(tmp_path / "a.fits")
    (tmp_path / "a.fits.run.toml").write_text("command = 'vsh-sim'\n")
    (tmp_path / ".DS_Store").write_bytes(b"\0")
    assert [path.name for path in epoch_files(tmp_path)] == ["a.fits"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(TableError, match="folder without tables"):
        epoch_files(tmp_path / "empty")


@pytest.mark.parametrize("lacking", [0, 1])
def test_folder_whose_files_differ(lacking, tmp_path):
    """Whether the first or the second lacks a column: sources of models that are refused were taken without a word."""
    table = sim.crf4(1, n_five=60)
    for k in range(2):
        part = table[30 * k : 30 * k + 30]
        if k == lacking:
            part.remove_column("astrometric_params")
        part.write(tmp_path / f"{k}.fits")
    with pytest.raises(TableError, match=f"{lacking}.fits has no column astrometric_params, .*{1 - lacking}.fits has"):
        read_field(tmp_path)


def test_partitions_by_a_column_are_refused(tmp_path):
    dataset = pytest.importorskip("pyarrow.dataset")
    parquet = pytest.importorskip("pyarrow.parquet")
    arrow = pytest.importorskip("pyarrow")
    table = sim.crf4(1, n_five=60)
    columns = {name: np.asarray(table[name]) for name in ("source_id", *NAMES, "astrometric_params")}
    parquet.write_to_dataset(arrow.table(columns), tmp_path / "d", partition_cols=["astrometric_params"])
    with pytest.raises(TableError, match="partitioned by astrometric_params"):
        read_field(tmp_path / "d")
    whole = dataset.dataset(tmp_path / "d", partitioning="hive")
    assert len(read_field(whole)) == len(read_field(table))


@pytest.mark.parametrize("name", ["e.parquet", "e.h5"])
def test_epochs_with_lists_that_are_masked(transits, tmp_path, name):
    """As astropy writes them: lists of masks beside the lists in Parquet, matrices in HDF5."""
    pytest.importorskip("pyarrow" if name.endswith("parquet") else "h5py")
    path, masked = tmp_path / name, transits.copy()
    position = np.ma.MaskedArray(masked["centroid_pos_al"])
    position[3, 4] = np.ma.masked
    masked["centroid_pos_al"] = position
    if name.endswith("parquet"):
        masked.write(path)
    else:
        masked["centroid_pos_al"] = position.filled(np.nan)
        tables.write_table(masked, path)
    found, whole = read_observations(path), read_observations(transits)
    assert len(found.time) == len(whole.time) - 1
