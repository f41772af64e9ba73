"""Arrays checked where they come in, and kept from being written to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from vsh.tools.errors import ParameterError, first_line
from vsh.tools.types import ArrayLike, FloatArray, IntArray


def float_array(
    name: str, value: Any, shape: Sequence[int] | None = None, finite: bool = True, broadcast: bool = False
) -> FloatArray:
    """A float array, perhaps of a given shape, without what is not finite and without a mask that hides something."""
    if np.ma.isMaskedArray(value) and np.ma.getmaskarray(value).any():
        raise ParameterError(f"{np.ma.getmaskarray(value).sum()} values of {name} are masked: take them out first")
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be numbers, not {type(value).__name__}") from None
    if broadcast and shape is not None:
        with suppress(ValueError):
            found = np.broadcast_to(found, shape)
    if shape is not None and found.shape != tuple(shape):
        raise ParameterError(f"{name} has shape {found.shape}, expected {tuple(shape)}")
    if finite and not np.isfinite(found).all():
        raise ParameterError(f"{np.sum(~np.isfinite(found))} of {found.size} values of {name} are not finite")
    return found


def covariance(name: str, value: Any, size: int) -> FloatArray:
    """A symmetric (size, size) matrix with variances that are not negative, read-only."""
    found = float_array(name, value, (size, size))
    scale = np.sqrt(np.maximum(np.diag(found), 0))
    if (np.diag(found) < 0).any():
        raise ParameterError(f"{name} has {np.sum(np.diag(found) < 0)} negative variances")
    if (np.abs(found - found.T) > 1e-8 * np.outer(scale, scale) + 1e-300).any():
        raise ParameterError(f"{name} is not symmetric")
    return read_only(found)


def indices(name: str, value: Any, n: int) -> IntArray:
    """Indices of some of n things, given by indices, a mask or a slice; all where None is given.

    Examples
    --------
    >>> indices("sources", [True, False, True], 3)
    array([0, 2])
    """
    everything = np.arange(n)
    if value is None:
        return everything
    try:
        found = everything[value if isinstance(value, slice) else np.asarray(value)]
    except (IndexError, TypeError, ValueError) as error:
        raise ParameterError(f"{name} are indices or a mask of {n}: {first_line(error)}") from None
    if found.ndim != 1:
        raise ParameterError(f"{name} are indices or a mask of {n}, one after the other, not of shape {found.shape}")
    return found


def read_only(array: ArrayLike) -> FloatArray:
    """The same array through a view that cannot be written to."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def dimension(size: int) -> Callable[[str, Any], FloatArray]:
    """A check for a float array of so many dimensions."""

    def check(name, value):
        found = float_array(name, value, finite=False)
        if found.ndim != size:
            raise ParameterError(
                f"{name} must be an array of {size} dimension{'s' * (size > 1)}, not of shape {found.shape}"
            )
        return found

    return check
