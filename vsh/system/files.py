"""Files and folders that are either whole or not there."""

from __future__ import annotations

import ctypes
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vsh.checks.types import PathName

_LOG = logging.getLogger(__name__)
#: How the names of files that are being written begin; nobody else's files do.
_UNFINISHED = ".vsh-unfinished-"


@contextmanager
def atomic_write(path: PathName) -> Iterator[Path]:
    """A name to write a new file under, which takes the place of `path` once it is complete.

    A process killed at any moment leaves the old file or the new one, never a part of either; any
    number of writers may write to one path at once, and one of them wins. A link stays a link: the
    file it names is replaced.

    Parameters
    ----------
    path : str or Path
        The file to be.

    Raises
    ------
    OSError
        If the folder is not there or cannot be written to.
    """
    path = Path(os.path.realpath(path))
    handle, name = tempfile.mkstemp(prefix=_UNFINISHED, suffix=f"-{path.name}", dir=path.parent)
    os.close(handle)
    new = Path(name)
    try:
        yield new
        with new.open("rb") as written:
            os.fsync(written.fileno())  # else a power cut could leave an empty file under the name
        os.chmod(new, _mode(path))
        os.replace(new, path)
        if _UNFINISHED not in str(path):  # of a folder the whole is told
            _LOG.info("written: %s", path)
    finally:
        new.unlink(missing_ok=True)


def remove_unfinished(folder: PathName) -> None:
    """Remove what killed writers left in a folder and below: files by the names that only `atomic_write` gives.

    Parameters
    ----------
    folder : str or Path
        Where to look.
    """
    for file in Path(folder).rglob(f"{_UNFINISHED}*"):
        if file.is_file() and not file.is_symlink():
            file.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: PathName) -> Iterator[Path]:
    """A new, empty folder that takes the place of `path` once it is complete.

    Killed at any moment, there is the old folder or the new one under the name, never a part of either.

    Parameters
    ----------
    path : str or Path
        The folder to be.
    """
    path = Path(os.path.realpath(path))
    _remove_abandoned(path)
    new = Path(tempfile.mkdtemp(prefix=_UNFINISHED, suffix=f"-{path.name}", dir=path.parent))
    try:
        yield new
        os.chmod(new, 0o777 & ~_umask())
        if path.exists():
            _exchange(new, path)
        else:
            os.replace(new, path)
        _LOG.info("written: %s", path)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _exchange(new, path):
    """Let two folders change names, in one step where the system can."""
    libc = ctypes.CDLL(None, use_errno=True)
    names = os.fsencode(new), os.fsencode(path)
    if hasattr(libc, "renameat2"):  # Linux: AT_FDCWD, RENAME_EXCHANGE
        if libc.renameat2(-100, names[0], -100, names[1], 2) == 0:
            return
    elif hasattr(libc, "renamex_np") and libc.renamex_np(*names, 2) == 0:  # macOS: RENAME_SWAP
        return
    old = path.with_name(f"{new.name}-old")  # elsewhere, in two steps
    os.replace(path, old)
    os.replace(new, path)
    shutil.rmtree(old, ignore_errors=True)


def _remove_abandoned(path, age=86400):
    """Remove what a killed writer of this folder left beside it a day ago or earlier."""
    for left in path.parent.glob(f"{_UNFINISHED}*-{path.name}"):
        try:
            if left.is_dir() and not left.is_symlink() and time.time() - left.stat().st_mtime > age:
                shutil.rmtree(left, ignore_errors=True)
        except OSError:
            continue


def _mode(path):
    """The permissions of the file that is replaced, or those a new one would have."""
    try:
        return path.stat().st_mode & 0o7777
    except OSError:
        return 0o666 & ~_umask()


def _umask():
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
