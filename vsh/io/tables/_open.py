"""What a user gives as a table, opened: files by their first bytes, folders, and objects in memory."""

import csv
import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any

from vsh.io.tables._arrow import open_dataset, open_lazy, open_parquet, open_stream
from vsh.io.tables._packed import first_bytes
from vsh.io.tables._remote import Place, files_at, is_address, open_at, place_of
from vsh.io.tables._source import TableSource, chained, is_frame, open_astropy, open_frame, open_other
from vsh.tools.arguments import explained
from vsh.tools.errors import TableError, first_line
from vsh.tools.formats import BY_KIND, BY_NAME, FORMATS, PACKED, READ
from vsh.tools.printing import printable
from vsh.tools.types import PathName, Table
from vsh.tools.writing import format_of

#: The name of the file in which a command keeps what came in on standard input; where it lies is nobody's business.
STANDARD_INPUT = "standard input"


def _open_file(path, label, kind):
    """A file of a known format, by the reader that its row names."""
    module, _, name = BY_KIND[kind].opens.partition(":")
    return getattr(import_module(module), name)(path, label)


#: Order and pixel of a partition of a HATS catalogue, by its path.
_PARTITION = re.compile(r"Norder=(\d+)/(?:.*/)?Npix=(\d+)")


@explained
def open_table(source: Any, format: str | None = None) -> TableSource:
    """Open a table without reading its rows.

    Parameters
    ----------
    source : path of a file or a folder of files, astropy Table, pandas DataFrame (or a class made from
        it), an object with `__arrow_c_stream__` (pyarrow, polars, DuckDB), dict or structured array The table.
    format : str, optional
        Format of a file by its name in `vsh.tools.formats.FORMATS`; its ending or its first bytes tell it unless given.

    Raises
    ------
    TableError
        If there is no such file, its format is not known, or it is damaged.
    """
    if isinstance(source, TableSource):
        return source
    if is_address(source) or isinstance(source, Place):
        return open_at(source, _open_fetched, BY_NAME[format].kind if format else None)
    if isinstance(source, (str, os.PathLike)):
        return _open_path(source, format)
    if is_frame(source):
        return open_frame(source)
    if any(c.__name__ == "Table" and c.__module__.startswith("astropy.table") for c in type(source).__mro__):
        return open_astropy(source)
    if hasattr(source, "__arrow_c_stream__") or hasattr(source, "__arrow_c_array__"):
        return open_stream(source, f"the {type(source).__name__}")
    its = type(source)
    if its.__name__ == "LazyFrame":
        return open_lazy(source, "the LazyFrame")
    if any(c.__name__ == "Dataset" and c.__module__.startswith("pyarrow") for c in its.__mro__):
        return open_dataset(source, "the Dataset")
    if hasattr(its, "__dask_graph__") or hasattr(its, "to_delayed"):
        raise TableError("a table of Dask is in parts: give it to vsh.io.catalogue.parts(…), or .compute() it")
    return open_other(source)


def _open_fetched(path, label, kind):
    return _open_file(path, label, kind or _kind(path, label))


def _open_path(path, format):
    if format is not None and format not in BY_NAME:
        raise TableError(f"no format is called {format!r}: {', '.join(BY_NAME)} are")
    text = os.fspath(path)
    text = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    label = STANDARD_INPUT if os.path.basename(text) == STANDARD_INPUT else printable(text)
    path = Path(path if not isinstance(path, bytes) else os.fsdecode(path))
    try:
        if path.is_dir():
            return _open_folder(path, label, format)
        if not path.is_file():
            raise TableError(f"{label}: no such file" if not path.exists() else f"{label} is no regular file")
        kind = BY_NAME[format].kind if format else _kind(path, label)
        return _open_file(path, label, kind)
    except (OSError, ValueError) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"{label} cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _kind(path, label):
    """The format of a file by its ending, or by its first bytes."""
    try:
        return format_of(path, READ)
    except TableError:
        if _described(path):
            return "ascii.cds"
        begin = first_bytes(path, label)
        for row in FORMATS:
            if row.begins is not None and row.begins.match(begin):
                return row.kind
        known = "" if label == STANDARD_INPUT else f" Known endings: {', '.join(READ)}, each also with .gz."
        raise TableError(
            f"{label}: unrecognised format.{known} Name it: --input-format {'|'.join(BY_NAME)}, where ascii is any text"
            " in columns (format=…)"
        ) from None


def _described(path):
    """Whether a file ReadMe of the CDS lies beside a file, and describes it."""
    readme = path.with_name("ReadMe")
    name = path.stem if path.suffix.lower() in PACKED else path.name
    try:
        return readme.is_file() and f"file: {name}".lower() in readme.read_text("utf-8", "replace").lower()
    except OSError:
        return False


def _open_folder(path, label, format):
    kind, files = _tables_in(path, label, format)
    if kind == "parquet":
        return open_parquet(files, label)  # one dataset
    return chained(label, [_open_file(file, printable(file), kind) for file in files])


def files_of(path: PathName, format: str | None = None) -> list[Any]:
    """The files that `open_table` would read from a path or an address: those of a folder by name, or the file."""
    if is_address(path):
        return files_at(place_of(path))
    path, label = Path(path), printable(path)
    if path.is_dir():
        return _tables_in(path, label, format)[1]
    if not path.is_file():
        raise TableError(f"{label}: no such file" if not path.exists() else f"{label} is no regular file")
    return [path]


def _tables_in(path, label, format=None):
    """The format and the files of a folder."""
    path = _main_table(path, label)
    if _is_hats(path):  # beside its partitions lie a thumbnail of them, and maps of the sky
        files = [each for each in sorted((path / "dataset").glob("Norder=*/**/*.parquet")) if each.is_file()]
        if not files:
            raise TableError(f"{label} is a catalogue in HATS format without partitions")
        _check_partitions(path, files, label)
        return "parquet", files
    kinds = {}
    for file in sorted(path.rglob("*")):
        inside = file.relative_to(path).parts
        if any(part.startswith((".", "_")) for part in inside) or not file.is_file():
            continue
        if format:
            kinds.setdefault(BY_NAME[format].kind, []).append(file)
            continue
        try:
            kinds.setdefault(format_of(file, READ), []).append(file)
        except TableError:
            continue
    if not kinds:
        raise TableError(f"{label} is a folder without tables: known endings are {', '.join(READ)}")
    if len(kinds) > 1:
        counts = ", ".join(f"{len(files)} of {kind.removeprefix('ascii.')}" for kind, files in kinds.items())
        raise TableError(f"{label} holds tables of several formats ({counts}): name a folder with those of one")
    return next(iter(kinds.items()))


def _is_hats(path):
    return (path / "hats.properties").is_file() or ((path / "properties").is_file() and (path / "dataset").is_dir())


def _check_partitions(path, files, label):
    """Raise TableError where partitions that a HATS catalogue lists are not there."""
    listed = path / "partition_info.csv"
    if not listed.is_file():
        return
    try:
        with listed.open(encoding="utf-8", errors="replace", newline="") as file:
            wanted = {(row.get("Norder"), row.get("Npix")) for row in csv.DictReader(file)}
    except csv.Error as error:
        raise TableError(f"{label}: its partition_info.csv is damaged ({error}): fetch it again") from None
    there = {found.groups() for each in files if (found := _PARTITION.search(each.as_posix()))}
    lost = sorted(f"Norder={order}, Npix={pixel}" for order, pixel in wanted - there if order and pixel)
    if lost:
        raise TableError(
            f"{label} lacks {len(lost)} of {len(wanted)} partitions that its partition_info.csv lists (first: "
            f"{printable(lost[0])}): fetch them again, or name the folder dataset to read what is there"
        )


def _main_table(path, label):
    """The main catalogue of a HATS collection, whose margin cache repeats sources; else the folder itself."""
    properties = path / "collection.properties"
    if not properties.is_file():
        return path
    pairs = (line.partition("=") for line in properties.read_text(encoding="utf-8", errors="replace").splitlines())
    name = {key.strip(): value.strip() for key, _, value in pairs}.get("hats_primary_table_url", "")
    if not name or not _is_hats(path / name):
        raise TableError(
            f"{label} is a HATS collection, whose margin cache repeats sources: name the folder of its main catalogue"
        )
    return path / name


def read_table(path: PathName) -> Table:
    """Read a whole table; `open_table` reads columns and blocks.

    Parameters
    ----------
    path : str or Path
        FITS, VOTable, ECSV, CSV (with Gaia's null) or Parquet, or a folder of them.

    Raises
    ------
    TableError
        If there is no such file, its format is not known, or it is damaged.
    """
    source = open_table(path)
    if not source.names:
        raise TableError(f"{source.label} has no columns")
    if source.meta.get("__special__"):  # columns of more than one number a row: astropy's own ECSV
        return _read_ecsv(path, source.label)
    return source.to_table()


def as_table(source: Any) -> Table:
    """A path or any table in memory as an astropy Table."""
    from astropy.table import Table

    return source if isinstance(source, Table) else read_table(source)


def _read_ecsv(path, label):
    from astropy.table import Table

    _check_memory(path, label)
    try:
        return Table.read(path, format="ascii.ecsv")
    except Exception as error:  # whatever a damaged file makes of a reader
        raise TableError(f"{label} cannot be read as ECSV: {first_line(error)}") from error


def _check_memory(path, label, most=2**28):
    """NumPy gives every row of a column of text the room of the longest."""
    longest = count = 0
    with open(path, "rb") as file:
        for line in file:
            if not line.startswith(b"#"):
                longest, count = max(longest, len(line)), count + 1
    if 4 * longest * count > max(most, 16 * Path(path).stat().st_size):
        raise TableError(f"{label} is damaged, or no result: a line of {longest} characters among {count}")
