"""What was wrong with the arguments of a call, by the annotations of the function: asked only once it has failed."""

from __future__ import annotations

import collections.abc
import types
import typing
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import numpy as np

from vsh.tools.errors import ParameterError, VshError
from vsh.tools.types import ArrayLike

P = ParamSpec("P")
T = TypeVar("T")
#: What a wrong type makes of code that was not written for it.
_ENDS = (AttributeError, TypeError, ValueError, LookupError, ArithmeticError)


def explained(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that an argument of a wrong type is named, where it would end in an error of Python's own.

    A call that succeeds costs nothing. One that fails is looked at: where an argument is not of the annotated type,
    the error is a ParameterError that says which; any other error stays as it is.

    Parameters
    ----------
    function : callable
        With annotated arguments.

    Examples
    --------
    >>> @explained
    ... def double(field: dict[str, int]) -> int:
    ...     return 2 * field["n"]
    >>> double(3)
    Traceback (most recent call last):
    vsh.tools.errors.ParameterError: field must be dict[str, int], not int
    """

    @wraps(function)
    def checked(*arguments: P.args, **options: P.kwargs) -> T:
        try:
            return function(*arguments, **options)
        except VshError:
            raise
        except _ENDS as error:
            words = _mistyped(function, arguments, options)
            if words is None:
                raise
            raise ParameterError(words) from error

    return checked


def _mistyped(function, arguments, options):
    """What to say of the first argument that is not of its annotated type, or None."""
    try:
        bound = signature(function).bind(*arguments, **options).arguments
        hints = typing.get_type_hints(function)
    except (TypeError, NameError):  # missing arguments, which Python's own message names; names for type checkers alone
        return None
    for name, value in bound.items():
        hint = hints.get(name, Any)
        if not _fits(value, hint):
            return f"{name} must be {_words(hint)}, not {_shown(value)}"
    return None


def _fits(value, hint):
    """Whether a value may be of a type, as far as that is cheap to see."""
    if hint is Any or isinstance(hint, (TypeVar, str)):
        return True
    if hint is None or hint is type(None):
        return value is None
    if hint == ArrayLike:
        return _is_arraylike(value)
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, each) for each in inside)
    if origin is typing.Literal:
        return any(value is each or (isinstance(value, str) and value == each) for each in inside)
    if origin is np.ndarray or hint is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype.kind in "iufbcUSO" and _numeric(value)
    if hint in (int, float, complex):
        return _is_number(value, hint)
    if hint is str or hint is bytes or hint is bool:
        return isinstance(value, hint)
    kind = origin or hint
    if not isinstance(kind, type):
        return True
    try:
        if not isinstance(value, kind):
            return False
    except TypeError:  # protocols that cannot be asked
        return True
    if isinstance(value, str) and kind in (collections.abc.Sequence, collections.abc.Iterable) and inside != (str,):
        return False
    if inside and isinstance(value, (list, tuple, set)) and kind is not tuple:
        return all(_fits(each, inside[0]) for each in value)
    if isinstance(value, tuple) and kind is tuple and inside and Ellipsis not in inside:
        return len(value) == len(inside) and all(_fits(value[k], each) for k, each in enumerate(inside))
    if isinstance(value, collections.abc.Mapping) and len(inside) == 2:
        return all(_fits(key, inside[0]) and _fits(each, inside[1]) for key, each in value.items())
    return True


def _is_arraylike(value):
    """Whether numbers can be made of a value; names in an array are let pass."""
    if isinstance(value, (str, bytes, bool)) or value is None:
        return False
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # of different lengths; a field is none
        return False
    return (
        array.dtype.kind in "iufb"
        or (array.dtype.kind in "US" and array.ndim > 0)
        or (array.dtype.kind == "O" and _numeric(array))
    )


def _is_number(value, hint):
    kinds = {int: "iu", float: "iuf", complex: "iufc"}[hint]
    return not isinstance(value, (bool, str, bytes)) and np.ndim(value) == 0 and np.asarray(value).dtype.kind in kinds


def _numeric(array):
    """Whether an array of objects or of text is one of numbers after all."""
    if array.dtype.kind not in "OUS":
        return True
    try:
        np.asarray(array, float)
    except (TypeError, ValueError):
        return False
    return True


def _words(hint):
    """A type as a reader knows it."""
    if hint == ArrayLike:
        return "numbers"
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_words, inside)))
    if origin is typing.Literal:
        return " or ".join(map(repr, inside))
    if origin is np.ndarray or hint is np.ndarray or hint == ArrayLike:
        return "an array of numbers"
    if hint is type(None) or hint is None:
        return "None"
    if origin is collections.abc.Callable:
        return "a function"
    return getattr(hint, "__name__", str(hint)) if origin is None else str(hint).replace("collections.abc.", "")


def _shown(value):
    """A value by its type, and as it is where that is short."""
    return repr(value) if isinstance(value, (int, float, str, bool, type(None))) else type(value).__name__
