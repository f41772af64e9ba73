"""Loops that numba compiles, where it is installed: kept on disk, and free of the interpreter's lock."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any


def kept(**options: Any) -> Callable[[Any], Any]:
    """A compiled function, kept on disk for the next time where there is a folder to write to."""
    from numba import njit

    def compiled(function):
        try:
            return njit(function, cache=True, nogil=True, **options)
        except RuntimeError:
            return njit(function, nogil=True, **options)

    return compiled


def there() -> bool:
    """Return whether numba is installed."""
    return find_spec("numba") is not None
