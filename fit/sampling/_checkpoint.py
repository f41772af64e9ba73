"""Chains that survive being killed: one file, whole or not there, that knows what it belongs to."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vsh.checks.types import ArrayLike, FloatArray, PathName
from vsh.errors import CheckpointError
from vsh.system.files import check_not_read, read_arrays, write_arrays

_STATE = ("key", "position", "has_gauss", "gauss")


def fingerprint(arrays: Iterable[ArrayLike], about: str, model: dict[str, str]) -> dict[str, str]:
    """What a chain belongs to: a hash of the data, and the model in words."""
    digest = sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return {"data": f"{about}, {digest.hexdigest()[:16]}"} | model


def save(
    path: PathName, fingerprint: dict[str, str], chain: FloatArray, log_probability: FloatArray, state: Any
) -> None:
    """Write a chain (steps, walkers, d), its log-densities and the state of its random numbers."""
    arrays = {"chain": chain, "log_probability": log_probability}
    arrays |= {name: np.asarray(value) for name, value in zip(_STATE, state[1:], strict=True)}
    identity = {"fingerprint": np.frombuffer(json.dumps(fingerprint).encode(), np.uint8)}
    write_arrays(path, identity | arrays)


def load(path: PathName, fingerprint: dict[str, str]) -> tuple[FloatArray, FloatArray, Any] | None:
    """Read a chain back: chain, log-densities, state of the random numbers; None where there is no file."""
    path = Path(path)
    if not path.exists():
        return None
    try:
        file = read_arrays(path)
        stored = json.loads(bytes(file["fingerprint"]).decode())
        chain, log_probability = file["chain"], file["log_probability"]
        state = ("MT19937", *(file[name] if name == "key" else file[name].item() for name in _STATE))
    except Exception as error:  # whatever a damaged file makes of zip and NumPy's headers
        raise CheckpointError(
            f"{path} is no chain of this program, or damaged ({type(error).__name__}): name another file, or delete it"
        ) from error
    other = [key for key in sorted({*fingerprint, *stored}) if fingerprint.get(key) != stored.get(key)]
    if other:
        said = "; ".join(f"{key}: there {stored.get(key)}, here {fingerprint.get(key)}" for key in other)
        raise CheckpointError(f"{path} holds a chain of another run ({said}): name another file, or delete it")
    return chain, log_probability, state


def check_writable(path: PathName) -> None:
    """Raise CheckpointError before the work, not after it."""
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise CheckpointError(f"{path}: there is no such folder")
    if not os.access(folder, os.W_OK) or Path(path).is_dir():
        raise CheckpointError(f"{path} cannot be written")
    check_not_read(path, f"the checkpoint {path}")
