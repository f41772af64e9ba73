"""What a field writes it reads back whole, in every format, frame and choice of columns; or it refuses to write it."""

import importlib.util

import numpy as np
import pytest

import vsh
from vsh import Field
from vsh.field import MEASURED
from vsh.sky.frames import AXES, FRAMES, REDSHIFT_FRAME_NAMES
from vsh.tools.errors import TableError

FORMATS = {"fits": None, "fits.gz": None, "vot": None, "ecsv": None, "csv": None, "csv.gz": None, "parquet": "pyarrow", "hdf5": "h5py"}  # fmt: skip
#: What a field may have beside its motions, in combinations.
CHOICES = {
    "motions": (),
    "names": ("name",),
    "magnitudes": ("magnitude", "redshift", "redshift_error"),
    "distances": ("distance", "distance_error"),
    "parallaxes": ("name", "parallax", "parallax_error"),
    "all": ("name", *MEASURED),
}


def sources(frame, choice, redshift_frame=None, n=30):
    rng = np.random.default_rng(1)
    columns = {name: rng.uniform(0.1, 0.9, n) for name in choice if name != "name"}
    for name in ("distance", "distance_error"):  # as far as such redshifts are
        if name in columns:
            columns[name] *= 4000
    for name in ("redshift", "distance", "distance_error"):  # of some sources they are not known
        if name in columns:
            columns[name][:3] = np.nan
    if "name" in choice:
        columns["name"] = np.array([f"J{k:04d}+01" for k in range(n)])
    if "redshift" in choice:
        columns["redshift_frame"] = redshift_frame
    return Field(
        rng.uniform(0, 6, n), rng.uniform(-1, 1, n), rng.normal(0, 300, (2, n)), rng.uniform(50, 90, (2, n)),
        rng.uniform(-0.5, 0.5, n), frame=frame, **columns,
    )  # fmt: skip


def assert_same(read, written):
    assert (read.frame, read.redshift_frame) == (written.frame, written.redshift_frame)
    for column in ("lon", "lat", "motion", "sigma", "rho", *MEASURED):
        ours, theirs = getattr(written, column), getattr(read, column)
        assert (ours is None) == (theirs is None), column
        if ours is not None:
            np.testing.assert_allclose(theirs, ours, rtol=1e-13, err_msg=column)
    if written.name is not None:
        assert list(map(str, read.name)) == list(map(str, written.name))


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("choice", CHOICES)
def test_a_field_is_read_as_it_was_written(ending, frame, choice, tmp_path):
    if FORMATS[ending] and importlib.util.find_spec(FORMATS[ending]) is None:
        pytest.skip(f"{FORMATS[ending]} is not installed")
    for redshift_frame in REDSHIFT_FRAME_NAMES if "redshift" in CHOICES[choice] else (None,):
        field = sources(frame, CHOICES[choice], redshift_frame)
        path = tmp_path / f"{redshift_frame}.{ending}"
        loses = ending.startswith("csv") and ({"distance", "parallax"} & set(CHOICES[choice]))
        if loses:
            with pytest.raises(TableError, match="CSV keeps no metadata"):
                field.write(path)
            assert not path.exists()
        else:
            field.write(path)
            assert_same(read := vsh.read_field(path), field)
            assert ending.startswith("csv") or not any("no unit" in note for note in read.notes)


@pytest.mark.parametrize("frame", FRAMES)
def test_pandas_keeps_a_field_through_csv_of_its_own(frame, tmp_path):
    field = sources(frame, ("name", "magnitude"))
    assert_same(vsh.read_field(field.to_pandas()), field)
    field.to_pandas().to_csv(tmp_path / "t.csv", index=False)
    assert_same(vsh.read_field(tmp_path / "t.csv"), field)


def test_names_beyond_ascii_are_kept_or_refused(tmp_path):
    field = sources("icrs", ())
    field = Field(field.lon, field.lat, field.motion, field.sigma, name=[f"Quäsar {k}" for k in range(30)])
    with pytest.raises(TableError, match="30 rows of column 'source_id'"):
        field.write(tmp_path / "t.fits")
    for ending in ("ecsv", "vot", "csv"):
        field.write(tmp_path / f"t.{ending}")
        assert_same(vsh.read_field(tmp_path / f"t.{ending}"), field)


@pytest.mark.parametrize("frame", FRAMES)
def test_what_a_field_wrote_is_read_as_one(frame, tmp_path):
    field = sources(frame, ("name",))
    for ending in ("fits", "h5"):
        field.write(tmp_path / f"f.{ending}", {"NOTE": "a test"})
        assert_same(vsh.read(tmp_path / f"f.{ending}"), field)
    table = field.to_table()
    assert (table[AXES[frame][2]].unit, table.meta.get("FRAME", "icrs")) == ("mas/yr", frame)
    assert_same(vsh.read_field(table), field)


def test_distances_of_a_table_of_somebody_else_are_for_users_to_say():
    table = sources("icrs", ("distance", "distance_error")).to_table()
    asked = {"distance": "distance", "distance_error": "distance_error"}
    assert_same(vsh.read_field(table), vsh.read_field(table, asked))
    del table.meta["MEASURED"]
    assert vsh.read_field(table).distance is None
