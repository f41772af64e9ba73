"""What a user gives as a table, opened: files by their first bytes, folders, addresses, and objects in memory.

Tables at s3:// and gs:// are opened by pyarrow, those at https:// and all else by fsspec. Parquet files give the byte
ranges of the wanted columns; files of other formats are fetched whole into a temporary file. Public buckets need no
credentials: where none are set up, or the address begins s3://anonymous@, none are used.
"""

import csv
import os
import re
import shutil
import zipfile
from dataclasses import replace
from http.client import responses
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from vsh.io.tables._arrow import open_dataset, open_lazyframe, open_parquet, open_parquet_at, open_stream
from vsh.io.tables._fits import open_fits
from vsh.io.tables._source import (
    TableSource,
    TemporaryPath,
    as_table_error,
    concatenate_sources,
    is_dataframe,
    open_astropy,
    open_dataframe,
    open_dict_or_array,
    open_skycoord,
    open_xarray,
    read_first_bytes,
    unpacking,
)
from vsh.io.tables._text import open_numbered_table
from vsh.tools import formats
from vsh.tools.errors import TableError, first_line
from vsh.tools.files import format_of
from vsh.tools.formats import BY_KIND, BY_NAME, FORMATS, PACKED, READ
from vsh.tools.parallel import name_step
from vsh.tools.printing import printable
from vsh.tools.types import PathName, Table

#: Seconds until a server that does not answer is given up.
CONNECT_TIME, ANSWER_TIME = 10.0, 60.0


def is_address(source: Any) -> bool:
    """Return whether a source is an address, s3://bucket/folder say, or an fsspec path (UPath)."""
    if isinstance(source, str):
        return formats.is_address(source)
    return any(c.__name__ == "UPath" for c in type(source).__mro__) and bool(source.protocol)


class RemotePath(NamedTuple):
    """A file or a folder at an address."""

    filesystem: Any
    path: str
    label: str
    address: Any

    def make_child(self, path: str) -> "RemotePath":
        """Make the path of a file within this folder."""
        return RemotePath(self.filesystem, path, f"{self.label.rstrip('/')}/{PurePosixPath(path).name}", None)


def fingerprint_of(remote_path: RemotePath) -> tuple[Any, ...]:
    """Read size, time of change and mark (ETag) of a file at an address, by which it is known again."""
    try:
        if hasattr(remote_path.filesystem, "handler"):  # of fsspec, whose libraries have names of their own for these
            file_info = remote_path.filesystem.handler.fs.info(remote_path.path)
            return tuple(str(file_info.get(name)) for name in ("size", "ETag", "mtime", "created", "LastModified"))
        file_info = remote_path.filesystem.get_file_info(remote_path.path)
        return file_info.size, file_info.mtime_ns
    except Exception as error:  # whatever a server that dies makes of its library
        raise (_find_refusal_error(remote_path) or _make_unreachable_error(remote_path.label, error)) from error


def find_remote_path(source: Any) -> RemotePath:
    """Find the file system and the path of an address."""
    address = source if isinstance(source, str) else f"{source.protocol}://{source.path.lstrip('/')}"
    label = printable(formats.hide_address_secrets(address))
    try:
        import pyarrow.fs
    except ImportError as error:
        raise TableError(
            f"{label} is an address, which needs pyarrow. Install what is missing: pip install "
            f"'vsh-astrometry[remote]' ({error})"
        ) from error
    try:
        if not isinstance(source, str):
            return RemotePath(pyarrow.fs.PyFileSystem(pyarrow.fs.FSSpecHandler(source.fs)), source.path, label, source)
        scheme = urlsplit(address).scheme
        if scheme in ("s3", "s3a"):
            return RemotePath(_open_s3_filesystem(address, pyarrow.fs), _find_bucket_path(address), label, source)
        if scheme in ("gs", "gcs"):
            anonymous = _is_anonymous(address, os.environ.get("GOOGLE_APPLICATION_CREDENTIALS"))
            return RemotePath(pyarrow.fs.GcsFileSystem(anonymous=anonymous), _find_bucket_path(address), label, source)
        import fsspec

        # Arrow asks for the ranges that it needs, and joins near ones: reading ahead would fetch the rest as well.
        http_options = {"cache_type": "none", "client_kwargs": {"timeout": _make_http_timeout()}}
        options = http_options if scheme in ("http", "https") else {}
        filesystem, path = fsspec.core.url_to_fs(address, **options)
        return RemotePath(pyarrow.fs.PyFileSystem(pyarrow.fs.FSSpecHandler(filesystem)), path, label, source)
    except ImportError as error:
        raise TableError(
            f"{label} cannot be reached: a library is missing ({first_line(error)}): pip install "
            "'vsh-astrometry[remote]'"
        ) from error
    except (OSError, ValueError, TypeError) as error:
        raise _make_unreachable_error(label, error) from error


def _make_http_timeout():
    import aiohttp

    return aiohttp.ClientTimeout(total=None, connect=CONNECT_TIME, sock_read=ANSWER_TIME)


def _find_bucket_path(address):
    url = urlsplit(address)
    return f"{url.netloc.rpartition('@')[2]}{url.path}".rstrip("/")


def _is_anonymous(address, has_credentials):
    """Return whether no credentials are used: asked for, or none are set up."""
    return urlsplit(address).netloc.rpartition("@")[0] == "anonymous" or not has_credentials


def _open_s3_filesystem(address, fs):
    settings = ("AWS_ACCESS_KEY_ID", "AWS_PROFILE", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_FULL_URI")
    has_credentials = any(map(os.environ.get, settings)) or os.path.exists(os.path.expanduser("~/.aws/credentials"))
    anonymous = _is_anonymous(address, has_credentials)
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL") or ""
    scheme, _, host = endpoint.rpartition("://")
    options = {"endpoint_override": host, "scheme": scheme or "https"} if host else {}
    region = os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION")
    options |= {"region": region} if region else {}
    return fs.S3FileSystem(anonymous=anonymous, connect_timeout=CONNECT_TIME, request_timeout=ANSWER_TIME, **options)


def _make_unreachable_error(label, error):
    is_missing = isinstance(error, FileNotFoundError)
    reason = "no such file, or no server answers" if is_missing else formats.hide_secrets(first_line(error))
    return TableError(
        f"{label} cannot be read: {reason}. Is there a network, and the address right? Started again, it is "
        "fetched again"
    )


def _find_refusal_error(remote_path):
    """Find the error of a web server that answers that it does not give a file; None where it gives it."""
    if not str(remote_path.address).startswith(("http://", "https://")):
        return None
    try:
        remote_path.filesystem.handler.fs.info(remote_path.path)
    except Exception as error:  # the library raises another error, from that with the status
        status = getattr(error.__cause__ or error.__context__, "status", None)
        if isinstance(status, int) and status >= 400:
            name = responses.get(status, "no reason")
            hint = "try again later" if status >= 500 else "look at the address"
            return TableError(f"{remote_path.label} cannot be read: the server answers {status} ({name}): {hint}")
    return None


def open_remote_table(source: Any, file_format: str | None) -> TableSource:
    """A table at an address."""
    remote_path = source if isinstance(source, RemotePath) else find_remote_path(source)
    label = remote_path.label
    files = list_remote_tables(remote_path)
    if len(files) > 1:
        raise TableError(f"{label} holds {len(files)} files: go through them with vsh.io.catalogue.parts, or --workers")
    (file,) = files
    file_format = file_format or _find_format_by_ending(file.path)
    if file_format == "parquet":
        try:
            return open_parquet_at(file.filesystem, file.path, label)
        except TableError as error:
            raise (_find_refusal_error(file) or error) from error
    path = TemporaryPath(PurePosixPath(file.path).name)
    try:
        with file.filesystem.open_input_stream(file.path, compression=None) as stream, open(path.name, "wb") as output:
            shutil.copyfileobj(stream, output, 2**20)
    except Exception as error:  # whatever a server that dies makes of its library
        raise (_find_refusal_error(file) or _make_unreachable_error(label, error)) from error
    file_format = file_format or _find_format(Path(path.name), label)
    return _keep_temporary_path(_open_table_file(Path(path.name), label, file_format), path)


def _keep_temporary_path(table_source, temporary_path):
    """A table that keeps the temporary path of the copy it is read from."""
    return replace(table_source, read=lambda names, rows, _held=temporary_path: table_source.read(names, rows))


def _find_format_by_ending(path):
    """Find the format that an ending says, or None."""
    try:
        return format_of(path, formats.READ)
    except TableError:
        return None


_COLLECTION_REFUSED = "is a HATS collection, whose margin cache repeats sources: name the folder of its main catalogue"


def list_remote_tables(location: RemotePath) -> list[RemotePath]:
    """List the tables of a folder at an address by name, or the file."""
    import pyarrow.fs as fs

    if isinstance(location.address, str) and location.address.startswith(("http://", "https://")):
        return [location]  # which lists no folders, and would be asked for the whole file to see whether it is there
    try:
        file_info = location.filesystem.get_file_info(location.path)
        if file_info.type == fs.FileType.File:
            return [location]
        if file_info.type == fs.FileType.NotFound:
            raise TableError(f"{location.label}: there is no such file or folder, or no server answers")
        entries = location.filesystem.get_file_info(fs.FileSelector(location.path, recursive=True))
    except Exception as error:  # whatever a server that dies makes of its library
        if isinstance(error, TableError):
            raise
        raise _make_unreachable_error(location.label, error) from error
    inside = {entry.path[len(location.path) :].lstrip("/"): entry.path for entry in entries if entry.is_file}
    if "collection.properties" in inside:
        raise TableError(f"{location.label} {_COLLECTION_REFUSED}")
    if "hats.properties" in inside or ("properties" in inside and any(p.startswith("dataset/") for p in inside)):
        paths = {p: full for p, full in inside.items() if p.startswith("dataset/Norder=") and p.endswith(".parquet")}
    else:
        hidden = {p for p in inside if any(component.startswith((".", "_")) for component in PurePosixPath(p).parts)}
        paths = {p: full for p, full in inside.items() if p not in hidden and _find_format_by_ending(p)}
    if not paths:
        raise TableError(f"{location.label} is a folder without tables: known endings are {', '.join(formats.READ)}")
    file_formats = {_find_format_by_ending(p) for p in paths}
    if len(file_formats) > 1:
        raise TableError(
            f"{location.label} holds tables of several formats ({', '.join(sorted(file_formats))}): name those of one"
        )
    return [location.make_child(paths[p]) for p in sorted(paths)]


#: The name of the file in which a command keeps what came in on standard input; where it lies is nobody's business.
STANDARD_INPUT = "standard input"


def _open_table_file(path, label, file_format):
    """A file of a known format, by the reader that its row names."""
    module, _, name = BY_KIND[file_format].opens.partition(":")
    return getattr(import_module(module), name)(path, label)


#: Text packs to a hundredth; what unpacks to more was made to fill a disk.
_MOST_EXPANSION = 200

#: Order and pixel of a partition of a HATS catalogue, by its path.
_PARTITION = re.compile(r"Norder=(\d+)/(?:.*/)?Npix=(\d+)(?:\.parquet$|/)")


@name_step("reading")
def open_table(source: Any, format: str | None = None) -> TableSource:
    """Open a table without reading its rows.

    Parameters
    ----------
    source : path of a file or a folder of files, astropy Table or SkyCoord, pandas DataFrame (or a subclass of
        it), an object with `__arrow_c_stream__` (pyarrow, polars, DuckDB), xarray Dataset, dict or structured array
        The table.
    format : str, optional
        Format of a file, as named in `vsh.tools.formats.FORMATS`. Unless given, it is found from the ending of the file
        or from its first bytes.

    Raises
    ------
    TableError
        If there is no such file, its format is not known, or it is damaged.
    """
    if isinstance(source, TableSource):
        return source
    if is_address(source) or isinstance(source, RemotePath):
        return open_remote_table(source, _find_format_kind(format))
    if isinstance(source, (str, os.PathLike)):
        return _open_table_at_path(source, format)
    if is_dataframe(source):
        return open_dataframe(source)
    if any(c.__name__ == "SkyCoord" for c in type(source).__mro__):
        return open_skycoord(source)
    if type(source).__name__ == "Dataset" and type(source).__module__.startswith("xarray"):
        return open_xarray(source)
    if any(c.__name__ == "Table" and c.__module__.startswith("astropy.table") for c in type(source).__mro__):
        return open_astropy(source)
    if hasattr(source, "__arrow_c_stream__") or hasattr(source, "__arrow_c_array__"):
        return open_stream(source, f"the {type(source).__name__}")
    cls = type(source)
    if cls.__name__ == "LazyFrame":
        return open_lazyframe(source, "the LazyFrame")
    if any(c.__name__ == "Dataset" and c.__module__.startswith("pyarrow") for c in cls.__mro__):
        return open_dataset(source, "the Dataset")
    if hasattr(cls, "__dask_graph__") or hasattr(cls, "to_delayed"):
        raise TableError("a table of Dask is in parts: give it to vsh.io.catalogue.parts(…), or .compute() it")
    return open_dict_or_array(source)


#: How the words begin that Git LFS puts in place of a file.
_LFS_POINTER = b"version https://git-lfs"
#: A file with several tables, and the number or the name of one: tables.tsv#2.
_NUMBERED_TABLE = re.compile(r"(.+)#([^#]+)")


def _find_format_kind(format):
    """Find the kind of a format by its name; None where it is not said."""
    if format is not None and format not in BY_NAME:
        raise TableError(f"no format is called {format!r}: {', '.join(BY_NAME)} are")
    return format and BY_NAME[format].kind


def _open_table_at_path(path, format):
    kind = _find_format_kind(format)
    path_text = os.fspath(path)
    path_text = path_text.decode("utf-8", "replace") if isinstance(path_text, bytes) else path_text
    label = STANDARD_INPUT if os.path.basename(path_text) == STANDARD_INPUT else printable(path_text)
    path = Path(path if not isinstance(path, bytes) else os.fsdecode(path))
    try:
        if path.is_dir():
            return _open_table_folder(path, label, format)
        if (match := _NUMBERED_TABLE.fullmatch(path_text)) and not path.exists() and Path(match[1]).is_file():
            path, table_word = Path(match[1]), match[2]
            if (kind or _find_format(path, label)) == "fits":
                return open_fits(path, label, table_word)
            if table_word.isdecimal():
                return open_numbered_table(path, int(table_word), label)
            raise TableError(f"{label}: tables of text have numbers, those of FITS names as well")
        if not path.is_file():
            raise TableError(f"{label}: no such file" if not path.exists() else f"{label} is no regular file")
        with path.open("rb") as file:
            if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
                raise TableError(f"{label} is a pointer of Git LFS in place of the file: fetch that (git lfs pull)")
        if path.suffix.lower() in ("", ".zip") and zipfile.is_zipfile(path):
            return _open_zipped_tables(path, label, format)
        return _open_table_file(path, label, kind or _find_format(path, label))
    except (OSError, ValueError) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"{label} cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _find_format(path, label):
    """Find the format of a file by its ending, or by its first bytes."""
    if kind := _find_format_by_ending(path):
        return kind
    if _has_cds_readme(path):
        return "ascii.cds"
    first_bytes = read_first_bytes(path, label)
    for table_format in FORMATS:
        if table_format.begins is not None and table_format.begins.match(first_bytes):
            return table_format.kind
    hint = f" Known endings: {', '.join(READ)}, each also with .gz, or several in a .zip." * (label != STANDARD_INPUT)
    raise TableError(
        f"{label}: unrecognised format.{hint} Name it: --columns format=NAME, of {'|'.join(BY_NAME)}, where ascii "
        "is any text in columns (format=…)"
    )


def _has_cds_readme(path):
    """Return whether a file ReadMe of the CDS lies beside a file, and describes it."""
    readme = path.with_name("ReadMe")
    name = path.stem if path.suffix.lower() in PACKED else path.name
    try:
        return readme.is_file() and f"file: {name}".lower() in readme.read_text("utf-8", "replace").lower()
    except OSError:
        return False


def _open_table_folder(path, label, format):
    file_format, files = _find_format_and_files(path, label, format)
    if file_format == "parquet":
        return open_parquet(files, label)  # one dataset
    return concatenate_sources(label, [_open_table_file(file, printable(file), file_format) for file in files])


def _open_zipped_tables(path, label, format):
    """The tables of a zip archive, as those of a folder."""
    temporary_path = TemporaryPath("tables")
    folder = Path(temporary_path.name)
    folder.mkdir()
    unpacking_errors = unpacking(label, zipfile.BadZipFile, NotImplementedError, RuntimeError)
    with unpacking_errors, zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        n_bytes, largest_size = sum(member.file_size for member in members), _MOST_EXPANSION * path.stat().st_size
        if n_bytes > largest_size:
            raise TableError(f"{label} would unpack to {n_bytes} bytes, more than {largest_size}: unpack it yourself")
        for number, member in enumerate(members):
            member_path = PurePosixPath(member.filename)
            if any(component.startswith((".", "_")) for component in member_path.parts):
                continue
            with archive.open(member) as stream, open(folder / f"{number:06d}-{member_path.name}", "wb") as output:
                shutil.copyfileobj(stream, output, 2**20)
    return _keep_temporary_path(_open_table_folder(folder, label, format), temporary_path)


def files_of(path: PathName, format: str | None = None) -> list[Any]:
    """List the files that `open_table` would read from a path or an address: those of a folder by name, or the file."""
    if is_address(path):
        return list_remote_tables(find_remote_path(path))
    path, label = Path(path), printable(path)
    if path.is_dir():
        return _find_format_and_files(path, label, format)[1]
    if not path.is_file():
        raise TableError(f"{label}: no such file" if not path.exists() else f"{label} is no regular file")
    return [path]


def _find_format_and_files(path, label, format=None):
    """Find the format and the files of a folder."""
    path = _find_main_catalogue(path, label)
    if _is_hats_catalogue(path):  # beside its partitions lie a thumbnail of them, and maps of the sky
        files = [file for file in sorted((path / "dataset").glob("Norder=*/**/*.parquet")) if file.is_file()]
        if not files:
            raise TableError(f"{label} is a catalogue in HATS format without partitions")
        return "parquet", _select_listed_partitions(path, files, label)
    groups = {}
    for file in sorted(path.rglob("*")):
        components = file.relative_to(path).parts
        if any(component.startswith((".", "_")) for component in components) or not file.is_file():
            continue
        if kind := _find_format_kind(format) or _find_format_by_ending(file):
            groups.setdefault(kind, []).append(file)
    folders = {folder for files in groups.values() for file in files for folder in file.relative_to(path).parts[:-1]}
    keys = {name.partition("=")[0] for name in folders if "=" in name} - {"Norder", "Dir", "Npix"}
    if keys:
        raise TableError(
            f"{label} is partitioned by {', '.join(sorted(keys))}, whose values are in the names of its folders alone: "
            "pyarrow.dataset.dataset(path, partitioning='hive') is taken in place of the path, or write it without"
        )
    if not groups:
        raise TableError(f"{label} is a folder without tables: known endings are {', '.join(READ)}")
    if len(groups) > 1:
        counts = ", ".join(f"{len(files)} of {kind.removeprefix('ascii.')}" for kind, files in groups.items())
        raise TableError(f"{label} holds tables of several formats ({counts}): name a folder with those of one")
    return next(iter(groups.items()))


def _is_hats_catalogue(path):
    return (path / "hats.properties").is_file() or ((path / "properties").is_file() and (path / "dataset").is_dir())


def _select_listed_partitions(path, files, label):
    """Return the partitions that a HATS catalogue lists; raise TableError unless all are there with all their rows."""
    info_path = path / "partition_info.csv"
    if not info_path.is_file():
        return files
    try:
        with info_path.open(encoding="utf-8", errors="replace", newline="") as file:
            partitions = {(row.get("Norder"), row.get("Npix")) for row in csv.DictReader(file)}
    except csv.Error as error:
        raise TableError(f"{label}: its partition_info.csv is damaged ({error}): fetch it again") from None
    numbered_files = [(match.groups(), file) for file in files if (match := _PARTITION.search(file.as_posix()))]
    file_partitions = {partition for partition, _ in numbered_files}
    absent = sorted(f"Norder={order}, Npix={pixel}" for order, pixel in partitions - file_partitions if order and pixel)
    if absent:
        raise TableError(
            f"{label} lacks {len(absent)} of {len(partitions)} partitions that its partition_info.csv lists (first: "
            f"{printable(absent[0])}): fetch them again, or name the folder dataset to read what is there"
        )
    listed_files = [file for partition, file in numbered_files if partition in partitions]
    stated_rows = _read_hats_property(path / "hats.properties", "hats_nrows")
    if stated_rows.isdecimal():
        from pyarrow.parquet import read_metadata

        with as_table_error(f"{label} cannot be read as Parquet"):
            n_rows = sum(read_metadata(file).num_rows for file in listed_files)
        if n_rows != int(stated_rows):
            raise TableError(f"{label} has {n_rows} rows, and its hats.properties says {stated_rows}: fetch it again")
    return listed_files


def _read_hats_property(path, key):
    """Read a value of a file of properties, empty where there is none."""
    if not path.is_file():
        return ""
    pairs = (line.partition("=") for line in path.read_text(encoding="utf-8", errors="replace").splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs}.get(key, "")


def _find_main_catalogue(path, label):
    """Find the main catalogue of a HATS collection, whose margin cache repeats sources; else the folder itself."""
    properties_path = path / "collection.properties"
    if not properties_path.is_file():
        return path
    name = _read_hats_property(properties_path, "hats_primary_table_url")
    if not name or not _is_hats_catalogue(path / name):
        raise TableError(f"{label} {_COLLECTION_REFUSED}")
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
        return _read_ecsv_table(path, source.label)
    return source.to_table()


def as_table(source: Any) -> Table:
    """A path or any table in memory as an astropy Table."""
    from astropy.table import Table

    return source if isinstance(source, Table) else read_table(source)


def _read_ecsv_table(path, label):
    from astropy.table import Table

    _check_longest_line(path, label)
    with as_table_error(f"{label} cannot be read as ECSV"):
        return Table.read(path, format="ascii.ecsv")


def _check_longest_line(path, label, limit=2**28):
    """Raise TableError where a line is so long that NumPy, which gives every row its room, would fill the memory."""
    longest_length = n_lines = 0
    with open(path, "rb") as file:
        for line in file:
            if not line.startswith(b"#"):
                longest_length, n_lines = max(longest_length, len(line)), n_lines + 1
    if 4 * longest_length * n_lines > max(limit, 16 * Path(path).stat().st_size):
        raise TableError(f"{label} is damaged, or no result: a line of {longest_length} characters among {n_lines}")
