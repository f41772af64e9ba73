"""What an interrupted solution goes on from."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vsh.checks.types import PathName
from vsh.errors import CheckpointError
from vsh.system.files import read_arrays, write_arrays


def key_of(things: Iterable[Any]) -> str:
    """A hash of arrays and plain values."""
    digest = hashlib.sha256()
    for each in things:
        digest.update(np.ascontiguousarray(each).tobytes() if isinstance(each, np.ndarray) else repr(each).encode())
    return digest.hexdigest()


def save(path: PathName, key: str, state: dict[str, Any]) -> None:
    """Write a state; whole, or not at all."""
    write_arrays(path, {"key": np.array(key)} | state)


def load(path: PathName, key: str) -> dict[str, Any] | None:
    """A state that was saved, or None where there is none."""
    if not Path(path).exists():
        return None
    try:
        found = read_arrays(path)
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise CheckpointError(f"{path} is damaged ({error}): delete it to begin anew") from error
    if str(found.pop("key", "")) != key:
        raise CheckpointError(f"{path} belongs to another solution: delete it to begin anew")
    return found
