"""Packed files: gzip, bzip2, xz and Zstandard, told by their first bytes and unpacked on the way."""

import bz2
import gzip
import io
import lzma
import os
import shutil
import tempfile
import weakref
import zlib
from pathlib import Path
from typing import Any

from vsh.tools.errors import TableError, first_line
from vsh.tools.types import PathName

#: What a damaged packed file makes of the libraries that unpack it.
DAMAGE = (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError)
_MAGIC = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\0": "xz", b"\x28\xb5\x2f\xfd": "zstd"}


def packing(begin: bytes) -> str | None:
    """How a file is packed that begins so; None where it is not."""
    return next((name for magic, name in _MAGIC.items() if begin.startswith(magic)), None)


def unpacked(path: PathName, label: str) -> io.BufferedReader:
    """The bytes of a file, unpacked where it is packed, as a stream to read from."""
    file = open(path, "rb")  # noqa: SIM115 (the caller closes the stream, and with it the file)
    kind = packing(file.peek(6)[:6])
    if kind is None:
        return file
    file.close()
    if kind == "gzip":
        return io.BufferedReader(gzip.open(path, "rb"), 2**20)
    if kind == "bzip2":
        return io.BufferedReader(bz2.open(path, "rb"), 2**20)
    if kind == "xz":
        return io.BufferedReader(lzma.open(path, "rb"), 2**20)
    try:
        import pyarrow
    except ImportError as error:
        raise TableError(
            f"{label} is packed with Zstandard, which needs pyarrow: pip install 'vsh-astrometry[parquet]' ({error})"
        ) from error
    return io.BufferedReader(pyarrow.input_stream(os.fspath(path), compression="zstd"), 2**20)


def first_bytes(path: PathName, label: str, count: int = 2**14) -> bytes:
    """The first bytes of a file, unpacked; as many as can be had where it is damaged."""
    try:
        with unpacked(path, label) as stream:
            return stream.read(count)
    except (*DAMAGE, TableError):
        return b""


class in_folder:
    """A file to be written under its own name, in a folder that is deleted when nobody holds this any more."""

    def __init__(self, name):
        folder = tempfile.mkdtemp(prefix="vsh-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.name = os.path.join(folder, name)


def plain_file(path: PathName, label: str) -> Any:
    """The file itself, or an unpacked copy that is deleted when nobody holds it any more: something with a `name`."""
    with open(path, "rb") as file:
        if packing(file.read(6)) is None:
            return file
    copy = in_folder(Path(path).stem)
    try:
        with unpacked(path, label) as stream, open(copy.name, "wb") as new:
            shutil.copyfileobj(stream, new, 2**20)
    except DAMAGE as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"{label} cannot be unpacked: {first_line(error)}. Fetch it again") from None
    return copy
