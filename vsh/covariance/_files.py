"""Matrices in files: NumPy's own, FITS images, text."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from vsh.checks.types import FloatArray, PathName
from vsh.errors import TableError, first_line


def read_matrix(path: PathName, check_shape: Callable[[tuple[int, ...]], Any]) -> FloatArray:
    """A matrix from a file: NumPy's .npy, the first image of two axes of a FITS file, or numbers as text."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".npy":
        with _refused(path):
            found = np.load(path, mmap_mode="r", allow_pickle=False)
        check_shape(found.shape)
    elif ending in (".fits", ".fit"):
        found = _from_fits(path, check_shape)
    else:
        with _refused(path):
            found = np.loadtxt(path, ndmin=2)
        check_shape(found.shape)
    with _refused(path):
        return np.array(found, float)


def _from_fits(path, check_shape):
    from astropy.io import fits

    with _refused(path):
        units = fits.open(path)
    with units:
        with _refused(path):
            images = [
                unit for unit in units if unit.is_image and unit.header.get("NAXIS") == 2 and "NAXIS2" in unit.header
            ]
            if not images:
                raise TableError(f"{path} holds no image of two axes")
        with _refused(path):
            shape = images[0].shape
        check_shape(shape)
        with _refused(path):
            return np.array(images[0].data, float)


@contextmanager
def _refused(path):
    try:
        yield
    except TableError:
        raise
    except Exception as error:  # whatever a damaged file makes of NumPy or Astropy, a tokenizer's error included
        raise TableError(f"{path} holds no matrix that can be read: {first_line(error)}") from None
