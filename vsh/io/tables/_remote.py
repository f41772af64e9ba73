"""Tables at addresses: s3:// and gs:// by pyarrow, https:// and all else by fsspec.

Parquet files give the byte ranges of the wanted columns; files of other formats are fetched whole into a temporary
file. Public buckets need no credentials: where none are set up, or the address begins s3://anonymous@, none
are used.
"""

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from vsh.io.tables._arrow import open_parquet_at
from vsh.io.tables._packed import in_folder
from vsh.io.tables._source import TableSource
from vsh.tools import formats
from vsh.tools.errors import TableError, first_line
from vsh.tools.printing import printable
from vsh.tools.writing import format_of

#: Seconds until a server that does not answer is given up.
CONNECT, ANSWER = 10.0, 60.0


def is_address(source: Any) -> bool:
    """Whether a source is an address, s3://bucket/folder say, or an fsspec path (UPath)."""
    if isinstance(source, str):
        return formats.is_address(source)
    return any(c.__name__ == "UPath" for c in type(source).__mro__) and bool(source.protocol)


class Place(NamedTuple):
    """A file or a folder at an address."""

    filesystem: Any
    path: str
    label: str
    address: Any

    def inside(self, path: str) -> "Place":
        """A file within this folder."""
        return Place(self.filesystem, path, f"{self.label.rstrip('/')}/{PurePosixPath(path).name}", None)


def place_of(source: Any) -> Place:
    """Where an address leads."""
    text = source if isinstance(source, str) else f"{source.protocol}://{source.path.lstrip('/')}"
    label = printable(formats.shown_address(text))
    try:
        import pyarrow.fs
    except ImportError as error:
        raise TableError(
            f"{label} is an address, which needs pyarrow. Install what is missing: pip install "
            f"'vsh-astrometry[remote]' ({error})"
        ) from error
    try:
        if not isinstance(source, str):
            return Place(pyarrow.fs.PyFileSystem(pyarrow.fs.FSSpecHandler(source.fs)), source.path, label, source)
        scheme = urlsplit(text).scheme
        if scheme in ("s3", "s3a"):
            return Place(_s3(text, pyarrow.fs), _below(text), label, source)
        if scheme in ("gs", "gcs"):
            anonymous = _anonymous(text, os.environ.get("GOOGLE_APPLICATION_CREDENTIALS"))
            return Place(pyarrow.fs.GcsFileSystem(anonymous=anonymous), _below(text), label, source)
        import fsspec

        # Arrow asks for the ranges that it needs, and joins near ones: reading ahead would fetch the rest as well.
        http = {"cache_type": "none", "client_kwargs": {"timeout": _http_timeout()}}
        options = http if scheme in ("http", "https") else {}
        filesystem, path = fsspec.core.url_to_fs(text, **options)
        return Place(pyarrow.fs.PyFileSystem(pyarrow.fs.FSSpecHandler(filesystem)), path, label, source)
    except ImportError as error:
        raise TableError(
            f"{label} cannot be reached: a library is missing ({first_line(error)}): pip install "
            "'vsh-astrometry[remote]'"
        ) from error
    except (OSError, ValueError, TypeError) as error:
        raise _unreachable(label, error) from error


def _http_timeout():
    import aiohttp

    return aiohttp.ClientTimeout(total=None, connect=CONNECT, sock_read=ANSWER)


def _below(text):
    parts = urlsplit(text)
    return f"{parts.netloc.rpartition('@')[2]}{parts.path}".rstrip("/")


def _anonymous(text, credentials):
    """Whether no credentials are used: asked for, or none are set up."""
    return urlsplit(text).netloc.rpartition("@")[0] == "anonymous" or not credentials


def _s3(text, fs):
    names = ("AWS_ACCESS_KEY_ID", "AWS_PROFILE", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_FULL_URI")
    set_up = any(map(os.environ.get, names)) or os.path.exists(os.path.expanduser("~/.aws/credentials"))
    anonymous = _anonymous(text, set_up)
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL") or ""
    scheme, _, host = endpoint.rpartition("://")
    given = {"endpoint_override": host, "scheme": scheme or "https"} if host else {}
    region = os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION")
    given |= {"region": region} if region else {}
    return fs.S3FileSystem(anonymous=anonymous, connect_timeout=CONNECT, request_timeout=ANSWER, **given)


def _unreachable(label, error):
    missing = isinstance(error, FileNotFoundError)
    reason = "no such file, or no server answers" if missing else formats.shown_addresses(first_line(error))
    return TableError(
        f"{label} cannot be read: {reason}. Is there a network, and the address right? Started again, it is "
        "fetched again"
    )


def open_at(source: Any, open_file: Any, kind: str | None = None) -> TableSource:
    """A table at an address; `open_file(path, label, kind)` opens a file that was fetched."""
    place = source if isinstance(source, Place) else place_of(source)
    label = place.label
    files = files_at(place)
    if len(files) > 1:
        raise TableError(f"{label} holds {len(files)} files: go through them with vsh.io.catalogue.parts, or --workers")
    (file,) = files
    kind = kind or _kind(file.path)
    if kind == "parquet":
        return open_parquet_at(file.filesystem, file.path, label)
    copy = in_folder(PurePosixPath(file.path).name)
    try:
        with file.filesystem.open_input_stream(file.path, compression=None) as stream, open(copy.name, "wb") as new:
            shutil.copyfileobj(stream, new, 2**20)
    except Exception as error:  # whatever a server that dies makes of its library
        raise _unreachable(label, error) from error
    opened = open_file(Path(copy.name), label, kind)
    return _keeping(opened, copy)


def _keeping(opened, copy):
    """A table that holds the copy it is read from."""

    def read(names, rows) -> Iterator[dict[str, Any]]:
        assert copy.name
        yield from opened.read(names, rows)

    return replace(opened, read=read)


def _kind(path):
    """The format that an ending says, or None."""
    try:
        return format_of(path, formats.READ)
    except TableError:
        return None


def files_at(place: Place) -> list[Place]:
    """The tables of a folder at an address by name, or the file."""
    import pyarrow.fs as fs

    if isinstance(place.address, str) and place.address.startswith(("http://", "https://")):
        return [place]  # which lists no folders, and would be asked for the whole file to see whether it is there
    try:
        info = place.filesystem.get_file_info(place.path)
        if info.type == fs.FileType.File:
            return [place]
        if info.type == fs.FileType.NotFound:
            raise TableError(f"{place.label}: there is no such file or folder, or no server answers")
        found = place.filesystem.get_file_info(fs.FileSelector(place.path, recursive=True))
    except Exception as error:  # whatever a server that dies makes of its library
        if isinstance(error, TableError):
            raise
        raise _unreachable(place.label, error) from error
    inside = {entry.path[len(place.path) :].lstrip("/"): entry.path for entry in found if entry.is_file}
    if "hats.properties" in inside or ("properties" in inside and any(p.startswith("dataset/") for p in inside)):
        wanted = {p: full for p, full in inside.items() if p.startswith("dataset/Norder=") and p.endswith(".parquet")}
    else:
        hidden = {p for p in inside if any(part.startswith((".", "_")) for part in PurePosixPath(p).parts)}
        wanted = {p: full for p, full in inside.items() if p not in hidden and _kind(p)}
    if not wanted:
        raise TableError(f"{place.label} is a folder without tables: known endings are {', '.join(formats.READ)}")
    kinds = {_kind(p) for p in wanted}
    if len(kinds) > 1:
        raise TableError(
            f"{place.label} holds tables of several formats ({', '.join(sorted(kinds))}): name those of one"
        )
    return [place.inside(wanted[p]) for p in sorted(wanted)]
