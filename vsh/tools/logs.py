"""What the packages tell the standard library's logging: which step gave what, in how long."""

import logging
import time
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

#: Within a step that tells of itself its own steps do not.
_INSIDE: ContextVar[bool] = ContextVar("inside", default=False)
_P = ParamSpec("_P")
_T = TypeVar("_T")

#: Packages with loggers; nothing is printed unless somebody listens to them.
PACKAGES = ("vsh", "sim", "fit", "study")
for _name in PACKAGES:
    logging.getLogger(_name).addHandler(logging.NullHandler())


def logged(words: str) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """A decorator: at level INFO the logger of a function's module says what came out of it, and how long it took.

    Examples
    --------
    >>> import logging, sys
    >>> logger = logging.getLogger(__name__)
    >>> @logged("half")
    ... def half(x):
    ...     return x / 2
    >>> half(4)
    2.0
    """

    def decorate(function: Callable[_P, _T]) -> Callable[_P, _T]:
        logger = logging.getLogger(function.__module__)

        @wraps(function)
        def timed(*args: _P.args, **options: _P.kwargs) -> _T:
            if not logger.isEnabledFor(logging.INFO):
                return function(*args, **options)
            begin, outer = time.perf_counter(), _INSIDE.set(True)
            try:
                result = function(*args, **options)
            finally:
                _INSIDE.reset(outer)
            log_result(logger, words, result, begin)
            return result

        return timed

    return decorate


def log_result(logger: logging.Logger, words: str, result: object, begin: float) -> None:
    """The same where a decorator would stand between a warning and whom it is for."""
    if not _INSIDE.get():
        logger.info("%s: %s, %.3g s", words, _short(result), time.perf_counter() - begin)


def _short(result):
    """In one line."""
    lines = repr(result).strip("<>").splitlines()
    return lines[0] if len(lines) == 1 and len(lines[0]) < 200 else type(result).__name__
