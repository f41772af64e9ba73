"""A table that is open: the columns it has, and its rows in blocks; packed files are unpacked on the way."""

import bz2
import gzip
import io
import lzma
import os
import shutil
import tempfile
import warnings
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vsh.sky.frames import FRAME_KEY, coordinate_columns
from vsh.tools.errors import TableError, first_line
from vsh.tools.files import check_unpacked_size
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import name_step
from vsh.tools.types import PathName, Table

#: What a damaged packed file makes of the libraries that unpack it.
DAMAGE = (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError)
_MAGIC = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\0": "xz", b"\x28\xb5\x2f\xfd": "zstd"}
_OPENERS: dict[str, Callable[..., Any]] = {"gzip": gzip.open, "bzip2": bz2.open, "xz": lzma.open}


def find_packing(first_bytes: bytes) -> str | None:
    """Find the packing of a file by its first bytes; None where it is not packed."""
    return next((packing for magic, packing in _MAGIC.items() if first_bytes.startswith(magic)), None)


def open_unpacked(path: PathName, label: str) -> io.BufferedReader:
    """The bytes of a file, unpacked where it is packed, as a stream to read from."""
    file = open(path, "rb")  # noqa: SIM115 (the caller closes the stream, and with it the file)
    compression = find_packing(file.peek(6)[:6])
    if compression is None:
        return file
    file.close()
    if compression in _OPENERS:
        return io.BufferedReader(_OPENERS[compression](path, "rb"), 2**20)
    try:
        import pyarrow
    except ImportError as error:
        raise TableError(
            f"{label} is packed with Zstandard, which needs pyarrow: pip install 'vsh-astrometry[parquet]' ({error})"
        ) from error
    return io.BufferedReader(pyarrow.input_stream(os.fspath(path), compression="zstd"), 2**20)


def read_first_bytes(path: PathName, label: str, n_bytes: int = 2**14) -> bytes:
    """Read the first bytes of a file, unpacked; as many as can be had where it is damaged."""
    try:
        with open_unpacked(path, label) as stream:
            return stream.read(n_bytes)
    except (*DAMAGE, TableError):
        return b""


@contextmanager
def as_table_error(message: str, remedy: str = "", kinds: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Whatever a damaged file makes of a reader within is a TableError: a message, what went wrong, and a remedy."""
    try:
        yield
    except TableError:
        raise
    except kinds as error:
        raise TableError(f"{message}: {first_line(error)}{remedy}") from error


def unpacking(label: str, *kinds: type[Exception]) -> AbstractContextManager[None]:
    """Damage that is found while a file is unpacked is a TableError."""
    return as_table_error(f"{label} cannot be unpacked", ". Fetch it again", (*DAMAGE, *kinds))


class TemporaryPath:
    """A file to be written under its own name, in a folder that is deleted when nobody holds this any more."""

    def __init__(self, name):
        folder = tempfile.mkdtemp(prefix="vsh-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.name = os.path.join(folder, name)


def unpack_file(path: PathName, label: str) -> Any:
    """Return the file itself, or an unpacked copy that is deleted when nobody holds it: something with a `name`."""
    with open(path, "rb") as file:
        if find_packing(file.read(6)) is None:
            return file
    temporary_path = TemporaryPath(Path(path).stem)
    with unpacking(label), open_unpacked(path, label) as stream, open(temporary_path.name, "wb") as output:
        while chunk := stream.read(2**20):
            output.write(chunk)
            check_unpacked_size(label, output.tell(), os.path.getsize(path))
    return temporary_path


#: Rows in a block where nobody asked for a number.
ROWS = 2**20


@dataclass(frozen=True)
class TableSource(InNotebook):
    """An open table of any format; only the requested columns are read."""

    label: str
    names: tuple[str, ...]
    read: Callable
    units: dict = field(default_factory=dict)
    meta: dict = field(default_factory=dict)
    notes: tuple = ()
    whole: int = ROWS
    descriptions: dict = field(default_factory=dict)
    #: Names that several columns of the file have: all but the first are numbered.
    twins: tuple[str, ...] = ()
    #: The coordinate system that a column states, and its equinox or None.
    systems: dict = field(default_factory=dict)
    #: Words on other tables in the same file, for a message; empty where there are none.
    others: str = ""
    #: Covariance of the positions of all n rows, east components first, (2n, 2n). [µas²]
    covariance: Any = None

    def blocks(self, names: Sequence[str] | None = None, rows: int = ROWS) -> Iterator[dict[str, Any]]:
        """Some columns in blocks of at most `rows` rows: dicts of (values, mask or None)."""
        request = tuple(self.names if names is None else names)
        # astropy keeps a mask that a format cannot hold as a column of its own beside the values.
        mask_names = tuple(f"{name}.mask" for name in request if f"{name}.mask" in self.names)
        for block in self.read(tuple(dict.fromkeys(request + mask_names)), rows):
            yield {name: _apply_mask_column(block, name) for name in request}

    @name_step("reading")
    def columns(self, names: Sequence[str] | None = None) -> dict[str, Any]:
        """Some columns whole, a dict of (values, mask or None); all of them unless named."""
        blocks = list(self.blocks(names, self.whole))
        return {name: join_blocks([block[name] for block in blocks]) for name in blocks[0]}

    def to_table(self) -> Table:
        """The whole as an astropy Table."""
        from astropy.table import Column, MaskedColumn, Table

        names = [name for name in self.names if not (name.endswith(".mask") and name[:-5] in self.names)]
        table = Table(meta=dict(self.meta))
        for name, (values, mask) in self.columns(names).items():
            unit = self.units.get(name)
            has_missing = mask is not None and mask.any()
            table[name] = MaskedColumn(values, mask=mask, unit=unit) if has_missing else Column(values, unit=unit)
        return table


def number_twins(names: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Names in which the second and further columns of one name are numbered, and the names that several have.

    Tables joined by TOPCAT, pandas or a cross-match repeat the columns of both sides.

    Examples
    --------
    >>> number_twins(["ra", "dec", "ra"])
    (['ra', 'dec', 'ra_2'], ('ra',))
    """
    counts: dict[str, int] = {}
    unique_names: dict[str, None] = {}
    original_names = set(names)
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        candidate, number = name, counts[name]
        while candidate in unique_names or (candidate != name and candidate in original_names):
            candidate, number = f"{name}_{number}", number + 1
        unique_names[candidate] = None
    return list(unique_names), tuple(name for name, count in counts.items() if count > 1)


def concatenate_sources(label: str, sources: Sequence[TableSource]) -> TableSource:
    """Several tables with the same columns, one after the other, as one; what is read must be in all of them."""
    reference = sources[0]
    first_sources = {name: source for source in reversed(sources) for name in source.names}
    all_names = tuple(dict.fromkeys(name for source in sources for name in source.names))
    units = {name: first_sources[name].units[name] for name in all_names if name in first_sources[name].units}

    def read(names, max_rows):
        for source in sources:
            for name in names:
                check_layout(source, first_sources[name].label, {name: str(units.get(name))})
            yield from source.read(names, max_rows)

    notes = tuple(dict.fromkeys(note for source in sources for note in source.notes))
    return TableSource(label, all_names, read, units, reference.meta, notes, descriptions=reference.descriptions)


def take_rows(block: Mapping[str, Any], rows: Any) -> dict[str, Any]:
    """Some rows of a block of columns, each a pair of its values and the mask of missing ones."""
    return {name: (values[rows], None if mask is None else mask[rows]) for name, (values, mask) in block.items()}


def cache_columns(source: TableSource) -> TableSource:
    """Cache the columns of a table, each of which is then read once."""
    cache: dict[str, Any] = {}

    def read(names, max_rows):
        missing_names = [name for name in names if name not in cache]
        cache.update(source.columns(missing_names) if missing_names else {})
        columns = {name: cache[name] for name in names}
        for start in range(0, max(1, len(next(iter(columns.values()))[0])), max_rows):
            chunk = slice(start, start + max_rows)
            yield take_rows(columns, chunk)

    return replace(source, read=read)


def check_layout(source: TableSource, label: str, units: Mapping[str, str]) -> None:
    """Raise TableError unless a table has the columns of another, in its units."""
    missing = [name for name in units if name not in source.names]
    if missing:
        raise TableError(f"{source.label} has no column {', '.join(missing)}, which {label} has")
    for name, unit in units.items():
        if str(source.units.get(name)) != unit:
            raise TableError(f"{source.label} has {name} in {source.units.get(name)}, {label} in {unit}")


def _apply_mask_column(block, name):
    values, mask = block[name]
    if f"{name}.mask" not in block:
        return values, mask
    mask_column = np.asarray(block[f"{name}.mask"][0])
    if mask_column.dtype.kind == "O":  # lists, in which some numbers are missing
        row_masks, nan_rows = [np.asarray(row, bool) for row in mask_column], np.empty(len(values), object)
        for i, (row, is_missing) in enumerate(zip(values, row_masks, strict=True)):
            nan_rows[i] = np.where(is_missing, np.nan, row)
        values, mask_column = nan_rows, np.array([row.all() for row in row_masks])
    mask_column = mask_column.astype(bool)
    return values, mask_column if mask is None else mask | mask_column


def join_blocks(blocks: Sequence[Any]) -> Any:
    """Values and masks of blocks of a column, one after the other."""
    if len(blocks) == 1:
        return blocks[0]
    values = np.concatenate([values for values, _ in blocks])
    if all(mask is None for _, mask in blocks):
        return values, None
    return values, np.concatenate([np.zeros(len(v), bool) if mask is None else mask for v, mask in blocks])


def open_astropy(table: Any) -> TableSource:
    """An astropy Table or QTable; a column of coordinates gives positions, motions and distances."""
    coordinate_names = [name for name in table.colnames if hasattr(table[name], "spherical")]
    if coordinate_names:
        plain_table = table[[name for name in table.colnames if name not in coordinate_names]]
        columns, frame = _convert_skycoord(table[coordinate_names[0]])
        for name, values in columns.items():
            if name not in plain_table.colnames:
                plain_table[name] = values
        plain_table.meta[FRAME_KEY] = frame
        return open_astropy(plain_table)
    names = tuple(table.colnames)
    units = {name: table[name].unit for name in names if getattr(table[name], "unit", None) is not None}

    def read(request, max_rows):
        for start in range(0, max(1, len(table)), max_rows):
            yield {name: _convert_astropy_column(table[name][start : start + max_rows]) for name in request}

    descriptions = {name: table[name].description for name in names if getattr(table[name], "description", None)}
    return TableSource("the table", names, read, units, dict(table.meta), descriptions=descriptions)


def open_skycoord(coord: Any) -> TableSource:
    """An astropy SkyCoord: positions, and motions and distances where it has them."""
    from astropy.table import Table

    columns, frame = _convert_skycoord(coord)
    return open_astropy(Table(columns, meta={FRAME_KEY: frame}))


def _convert_skycoord(coord):
    """Convert coordinates to columns in the names of Gaia's archive, and find their frame."""
    if coord.isscalar:
        raise TableError("the SkyCoord holds one position: give it arrays")
    return coordinate_columns(coord, TableError)


def open_xarray(dataset: Any) -> TableSource:
    """An xarray Dataset of one dimension; units are in the attributes of its variables."""
    from astropy.table import Table

    variables = {str(name): dataset[name] for name in (*dataset.data_vars, *dataset.coords) if dataset[name].ndim == 1}
    sizes = {variable.size for variable in variables.values()}
    if len(sizes) != 1:
        raise TableError(f"the Dataset has {len(sizes)} lengths of variables with one dimension: one is expected")
    table = Table({name: np.asarray(variable.values) for name, variable in variables.items()}, meta=dict(dataset.attrs))
    units = {name: str(variable.attrs["units"]) for name, variable in variables.items() if variable.attrs.get("units")}
    return replace(open_astropy(table), label="the Dataset", units=units)


def open_dataframe(frame: Any) -> TableSource:
    """A pandas DataFrame, or an object of a class made from it (geopandas, LSDB's NestedFrame)."""
    names = tuple(map(str, frame.columns))
    if len(set(names)) < len(names):
        raise TableError(f"the table has several columns of one name: {', '.join(names)}")
    places = dict(zip(names, range(len(names)), strict=True))

    def read(request, max_rows):
        for start in range(0, max(1, len(frame)), max_rows):
            yield {name: _convert_series(frame.iloc[start : start + max_rows, places[name]], name) for name in request}

    meta = {str(key): value for key, value in getattr(frame, "attrs", {}).items()}
    stated_units = meta.get("units")  # as users of pandas keep them
    stated_units = stated_units if isinstance(stated_units, Mapping) else {}
    units = {name: str(stated_units[name]) for name in names if name in stated_units}
    return TableSource("the table", names, read, units, meta)


def open_dict_or_array(table: Any) -> TableSource:
    """A dict of columns or a structured array."""
    from astropy.table import Table

    if isinstance(table, (int, float, complex, bytes)) or table is None:
        raise TableError(f"a {type(table).__name__} is no table")
    with as_table_error(f"a {type(table).__name__} is no table"):  # whatever astropy makes of what is none
        return open_astropy(Table(table))


def is_dataframe(value: Any) -> bool:
    """Return whether an object is pandas' DataFrame or made from it; pandas need not be installed."""
    return any(c.__name__ == "DataFrame" and c.__module__.split(".")[0] == "pandas" for c in type(value).__mro__)


def _convert_astropy_column(column):
    mask = getattr(column, "mask", None)
    values = getattr(column, "unmasked", column)
    values = getattr(values, "value", values)
    mask = None if mask is None or not np.any(mask) else np.array(np.broadcast_to(mask, np.shape(column)))
    return np.asarray(np.ma.getdata(values)), mask


def _convert_series(series, name):
    mask = series.isna().to_numpy()
    if isinstance(series.dtype, np.dtype) and series.dtype.kind == "f":
        return series.to_numpy(), None  # a nan is not finite, as in every format
    type_code = series.dtype.kind
    with as_table_error(f"column {name!r} cannot be read", kinds=(TypeError, ValueError)):
        if isinstance(series.dtype, np.dtype) and type_code != "O":
            values = series.to_numpy()
        elif type_code in "iu":
            values = series.to_numpy(dtype=f"{type_code}8", na_value=0)
        elif type_code == "f":
            values = series.to_numpy(dtype="f8", na_value=np.nan)
        elif type_code == "b":
            values = series.to_numpy(dtype=bool, na_value=False)
        else:
            values = series.to_numpy(dtype=object)
            if all(isinstance(value, str) for value in values[~mask]):
                values = np.array(np.where(mask, "", values), dtype=str)
    return values, mask if mask.any() else None


#: Sexagesimal columns as journals and the CDS name them.
_SEXAGESIMAL = ("RAh", "RAm", "RAs", "DE-", "DEd", "DEm", "DEs")
#: Text that is read whole may have so many bytes; larger tables come as CSV, FITS or Parquet.
_MOST_TEXT_BYTES = 2**30
#: A column of HDF5 of more bytes is none. [bytes]
_MOST_HDF5_BYTES = 2**34


def open_whole_table(path: PathName, label: str, kind: str) -> TableSource:
    """A table that is read as a whole; masked values stay masked, units and descriptions are kept."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # units that a format spells in its own way
            if kind == "hdf5":
                unpacked_file = unpack_file(path, label)
                table = _read_hdf5_table(unpacked_file.name, label)
            else:
                table = _read_text_table(Path(path), label, kind)
    except (TableError, MemoryError):
        raise
    except ImportError as error:
        raise TableError(f"{label} needs h5py: pip install 'vsh-astrometry[hdf5]' ({first_line(error)})") from error
    except Exception as error:  # whatever a damaged file makes of h5py and of the readers of text
        raise TableError(f"{label} cannot be read as {kind.removeprefix('ascii.')}: {first_line(error)}") from error
    if not len(table):
        raise TableError(f"{label} has no rows")
    return replace(open_astropy(_add_degree_columns(table)), label=label)


#: HDF5 has at most so many groups within each other.
_DEEPEST = 20


def _read_hdf5_table(path, label):
    """The one table of a file: a compound dataset, a group with a dataset for each column, or one of pandas or vaex."""
    import h5py
    from astropy.table import Table

    with h5py.File(path, "r") as file:
        compound_names, names_by_group = [], {}
        file_size, total_bytes = Path(path).stat().st_size, 0

        def collect_dataset(name, hdf5_object):
            nonlocal total_bytes
            if name.count("/") > _DEEPEST:
                raise TableError(f"{label} has more than {_DEEPEST} groups within groups: keep its table at the top")
            if not isinstance(hdf5_object, h5py.Dataset):
                return
            if hdf5_object.external or hdf5_object.is_virtual:
                raise TableError(
                    f"{label}: {name} keeps its numbers in another file, where nothing is read from: copy them into it "
                    "(h5repack)"
                )
            total_bytes += hdf5_object.nbytes
            check_unpacked_size(label, total_bytes, file_size)
            if total_bytes > _MOST_HDF5_BYTES:
                raise TableError(
                    f"{label} has {total_bytes / 2**30:.3g} GiB, and HDF5 is read whole: make it FITS or Parquet"
                )
            if hdf5_object.dtype.names:
                compound_names.append(name)
            elif hdf5_object.ndim == 1:
                names_by_group.setdefault(name.rpartition("/")[0], []).append(name)

        file.visititems(collect_dataset)
        if columns := _read_pandas_columns(file, label) or _read_vaex_columns(file, names_by_group):
            return Table(columns)
        tables = [name for name in compound_names if not name.endswith("__table_column_meta__")]
        column_groups = {group: names for group, names in names_by_group.items() if len(names) > 1 and not tables}
        if len(tables) + len(column_groups) != 1:
            present = ", ".join([*tables, *column_groups]) or "none"
            raise TableError(f"{label} holds {len(tables) + len(column_groups)} tables ({present}): keep one in a file")
        if column_groups:
            (names,) = column_groups.values()
            return Table({name.rpartition("/")[2]: _decode_column(file[name][()]) for name in names})
    return Table.read(path, path=tables[0], format="hdf5", character_as_bytes=False)


def _read_pandas_columns(file, label):
    """Read the columns of numbers of the one frame that pandas wrote; none where it wrote none."""
    frames = [group for group in file.values() if "pandas_type" in group.attrs]
    if len(frames) > 1:
        raise TableError(f"{label} holds {len(frames)} frames of pandas: keep one in a file")
    for frame in frames:
        field_names = frame["table"].dtype.names or () if "table" in frame else ()
        if any(name.startswith("values_block_") for name in field_names):
            raise TableError(
                f"{label}: pandas keeps the names of these columns as Python objects, which are not read from files. "
                "Write it with data_columns=True, or as Parquet; in Python vsh.read_field(pandas.read_hdf(…)) reads it"
            )
        columns = {}
        for key in [key for key in frame if key.endswith("_values") and frame[key].ndim == 2]:
            item_names = _decode_column(frame[key.replace("_values", "_items")][()])
            columns |= dict(zip(item_names.tolist(), frame[key][()].T, strict=True))
        return columns
    return {}


def _read_vaex_columns(file, group_names):
    """Read the columns of numbers of a file of vaex, which has a group for each."""
    from astropy.table import MaskedColumn

    columns = {}
    for name in [name for name in group_names if name.startswith("table/columns/") and f"{name}/data" in file]:
        group = file[name]
        if "indices" not in group:  # of text
            mask = group["mask"][()] if "mask" in group else False
            columns[name.rpartition("/")[2]] = MaskedColumn(group["data"][()], mask=mask, unit=group.attrs.get("unit"))
    return columns


def _decode_column(values: Any) -> Any:
    return np.char.decode(values.astype(bytes), "utf-8", "replace") if values.dtype.kind in "SO" else values


def _read_text_table(path, label, file_format):
    from astropy.io import ascii

    readme = path.with_name("ReadMe")
    unpacked_file = unpack_file(path, label)
    n_bytes = Path(unpacked_file.name).stat().st_size
    if n_bytes > _MOST_TEXT_BYTES:
        raise TableError(
            f"{label} has {n_bytes / 2**30:.1f} GiB, too much for text that is read whole: make it CSV, FITS or Parquet"
        )
    with open(unpacked_file.name, "rb") as file:
        first_bytes = file.read(2**16)
    if b"\0" in first_bytes:
        raise TableError(f"{label} is no text")
    if file_format == "ascii":
        return ascii.read(unpacked_file.name, format=None, guess=True)
    if file_format == "ascii.ipac":
        return ascii.read(unpacked_file.name, format="ipac", guess=False)
    if b"Byte-by-byte" not in first_bytes:
        if not readme.is_file():
            raise TableError(f"{label} does not describe its columns, and there is no file ReadMe beside it that does")
        return ascii.read(unpacked_file.name, format="cds", guess=False, readme=str(readme))
    lines = Path(unpacked_file.name).read_text("utf-8", "replace").splitlines()
    if lines[0].startswith("#"):  # written behind comment marks
        lines = [line.removeprefix("#").removeprefix(" ") for line in lines]
    return ascii.read(lines, format=file_format.removeprefix("ascii."), guess=False)


def _add_degree_columns(table):
    """Add ra and dec in degrees, where the table has hours, minutes and seconds, and no others."""
    if not set(_SEXAGESIMAL) <= set(table.colnames) or {"ra", "dec"} & set(table.colnames):
        return table
    hours, minutes, seconds, sign, degrees, arcmin, arcsec = (table[name] for name in _SEXAGESIMAL)
    signs = np.where(np.ma.getdata(sign).astype(str) == "-", -1.0, 1.0)
    ra = 15 * (np.ma.asarray(hours) + np.ma.asarray(minutes) / 60 + np.ma.asarray(seconds) / 3600)
    dec = signs * (np.ma.asarray(degrees) + np.ma.asarray(arcmin) / 60 + np.ma.asarray(arcsec) / 3600)
    from astropy.table import MaskedColumn

    table.add_columns([MaskedColumn(ra, unit="deg"), MaskedColumn(dec, unit="deg")], names=["ra", "dec"])
    return table


open_hdf5 = partial(open_whole_table, kind="hdf5")
open_mrt = partial(open_whole_table, kind="ascii.mrt")
open_cds = partial(open_whole_table, kind="ascii.cds")
open_ipac = partial(open_whole_table, kind="ascii.ipac")
open_ascii = partial(open_whole_table, kind="ascii")
