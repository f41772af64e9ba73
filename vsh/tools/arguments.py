"""Arguments and arrays checked where they come in; each refusal is a `ParameterError` that names the argument."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import wraps
from inspect import signature
from operator import index
from typing import Any, ParamSpec, TypeAlias, TypeVar

import numpy as np

from vsh.tools.errors import ParameterError, first_line, unknown_argument_error
from vsh.tools.types import ArrayLike, FloatArray, IntArray

P = ParamSpec("P")
T = TypeVar("T")
#: What an argument is checked by: from its name and value to what takes its place.
Check: TypeAlias = Callable[[str, Any], Any]


def number(name: str, value: Any) -> float:
    """A finite number, as a float."""
    try:
        converted = float(value) if np.ndim(value) == 0 and not isinstance(value, (str, bytes)) else np.nan
    except (TypeError, ValueError):
        converted = np.nan
    if not np.isfinite(converted):
        raise ParameterError(f"{name} must be a finite number, not {value!r}")
    return converted


def positive(name: str, value: Any) -> float:
    """A finite number above zero, as a float."""
    checked = number(name, value)
    if not checked > 0:
        raise ParameterError(f"{name} must be above zero, not {value!r}")
    return checked


def not_negative(name: str, value: Any) -> float:
    """A finite number of zero or more, as a float."""
    checked = number(name, value)
    if not checked >= 0:
        raise ParameterError(f"{name} must be zero or more, not {value!r}")
    return checked


def between(name: str, value: Any, lower: float, upper: float) -> float:
    """A number lower < x < upper, as a float."""
    checked, lower, upper = number(name, value), number("lower", lower), number("upper", upper)
    if not lower < checked < upper:
        raise ParameterError(f"{name} must lie between {lower:g} and {upper:g}, not at {value!r}")
    return checked


def whole(name: str, value: Any, least: int = 1) -> int:
    """A whole number of at least `least`, as an int."""
    try:
        converted = index(value) if np.ndim(value) == 0 else None
    except TypeError:
        converted = None
    if converted is None or isinstance(value, (bool, np.bool_)) or converted < least:
        raise ParameterError(f"{name} must be a whole number of at least {least}, not {value!r}")
    return converted


def choice(name: str, value: Any, choices: Sequence[Any]) -> Any:
    """Check that a value is one of some words."""
    if not isinstance(choices, (tuple, list)):
        raise ParameterError(f"choices are a tuple, not {type(choices).__name__}")
    for allowed in choices:
        if value is allowed or (isinstance(value, (str, int)) and type(value) is type(allowed) and value == allowed):
            return value
    raise ParameterError(f"{name} must be one of {', '.join(map(repr, choices))}, not {value!r}")


def generator(rng: Any) -> np.random.Generator:
    """A NumPy Generator from what users give as `rng`: a Generator, a SeedSequence, or whole numbers."""
    seeds = rng if isinstance(rng, (list, tuple)) else np.ravel(rng) if isinstance(rng, np.ndarray) else (rng,)
    is_numpy = isinstance(rng, (np.random.Generator, np.random.BitGenerator, np.random.SeedSequence))
    if is_numpy or (len(seeds) and all(isinstance(x, (int, np.integer)) and not isinstance(x, bool) for x in seeds)):
        with suppress(TypeError, ValueError):
            return np.random.default_rng(rng)
    description = repr(rng) if isinstance(rng, (int, float, str)) or rng is None else type(rng).__name__
    raise ParameterError(f"rng is a NumPy Generator or a whole number that seeds one, not {description}")


def accepts(**checks: Check) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Check some arguments of a function before it begins, each by a function of (name, value).

    What a check returns takes the argument's place, defaults among them. None is not checked where it is the
    default: the argument is not given then.

    Examples
    --------
    >>> @accepts(x=positive)
    ... def root(x):
    ...     return x ** 0.5
    >>> root("four")
    Traceback (most recent call last):
    vsh.tools.errors.ParameterError: x must be a finite number, not 'four'
    """

    def decorate(function):
        call_signature = signature(function)

        @wraps(function)
        def call_checked(*arguments, **options):
            try:
                bound_arguments = call_signature.bind(*arguments, **options)
            except TypeError:
                try:
                    return function(*arguments, **options)  # whose own error names it
                except TypeError as error:
                    raise unknown_argument_error(function, error) from None
            bound_arguments.apply_defaults()
            for name, check in checks.items():
                value = bound_arguments.arguments[name]
                if not (value is None and call_signature.parameters[name].default is None):
                    bound_arguments.arguments[name] = check(name, value)
            return function(*bound_arguments.args, **bound_arguments.kwargs)

        return call_checked

    return decorate


def a(*classes: type) -> Check:
    """A check that a value is of one of some classes.

    Examples
    --------
    >>> a(int)("n", "three")
    Traceback (most recent call last):
    vsh.tools.errors.ParameterError: n must be int, not str
    """

    def check_class(name, value):
        if not isinstance(value, classes):
            class_names = " or ".join(cls.__name__ for cls in classes)
            remark = getattr(type(value), "not_taken", "")
            raise ParameterError(f"{name} must be {class_names}, not {type(value).__name__}{remark}")
        return value

    return check_class


def seed(name: str, value: Any) -> Any:
    """A NumPy Generator, or a whole number of at least zero."""
    if isinstance(value, (bool, float, str)) or value is None:
        raise ParameterError(f"{name} is a NumPy Generator or a whole number that seeds one, not {value!r}")
    generator(value)
    return value


#: Units of arguments by their names, the same in all of the package; of numbers without a unit they are taken.
_UNITS = dict.fromkeys(("lon", "lat"), "rad") | dict.fromkeys(("sigma", "motion", "noise"), "uas/yr")
_UNITS |= {"distance": "Mpc", "velocity": "km/s"}


def in_unit(name: str, value: Any, unit: str | None = None) -> Any:
    """Numbers in the unit of an argument: a Quantity is converted, and what is none is in it already.

    Columns of an astropy Table keep the name of a unit that they no longer have: np.radians(table["ra"]) says "deg".

    Raises
    ------
    ParameterError
        If the unit is of another kind, or numbers without a unit are expected.
    """
    if type(value) is np.ndarray or not hasattr(value, "to_value"):
        return value
    unit = unit or _UNITS.get(name, "")
    try:
        return value.to_value(unit)
    except (ValueError, TypeError):  # astropy's UnitConversionError is one
        expected = f"cannot be turned into {unit}" if unit else "though it is a number without a unit"
        raise ParameterError(f"{name} is in {value.unit}, {expected}: give numbers, x.to_value(…)") from None


def float_array(
    name: str,
    value: Any,
    shape: Sequence[int] | None = None,
    finite: bool = True,
    broadcast: bool = False,
    unit: str | None = None,
) -> FloatArray:
    """A float array, perhaps of a given shape, without what is not finite and without a mask that hides something."""
    value = in_unit(name, value, unit)
    if np.ma.isMaskedArray(value) and np.ma.getmaskarray(value).any():
        raise ParameterError(f"{np.ma.getmaskarray(value).sum()} values of {name} are masked: take them out first")
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be numbers, not {type(value).__name__}") from None
    if broadcast and shape is not None:
        with suppress(ValueError):
            array = np.broadcast_to(array, shape)
    if shape is not None and array.shape != tuple(shape):
        raise ParameterError(f"{name} has shape {array.shape}, expected {tuple(shape)}")
    if finite and not np.isfinite(array).all():
        raise ParameterError(f"{np.sum(~np.isfinite(array))} of {array.size} values of {name} are not finite")
    return array


def covariance(name: str, value: Any, size: int) -> FloatArray:
    """A symmetric (size, size) matrix with variances that are not negative, read-only."""
    matrix = float_array(name, value, (size, size))
    scale = np.sqrt(np.maximum(np.diag(matrix), 0))
    if (np.diag(matrix) < 0).any():
        raise ParameterError(f"{name} has {np.sum(np.diag(matrix) < 0)} negative variances")
    if (np.abs(matrix - matrix.T) > 1e-8 * np.outer(scale, scale) + 1e-300).any():
        raise ParameterError(f"{name} is not symmetric")
    return read_only(matrix)


def indices(name: str, value: Any, n: int) -> IntArray:
    """Indices of some of n things, given by indices, a mask or a slice; all where None is given."""
    all_indices = np.arange(n)
    if value is None:
        return all_indices
    try:
        rows = all_indices[value if isinstance(value, slice) else np.asarray(value)]
    except (IndexError, TypeError, ValueError) as error:
        raise ParameterError(f"{name} are indices or a mask of {n}: {first_line(error)}") from None
    if rows.ndim != 1:
        raise ParameterError(f"{name} are indices or a mask of {n}, one after the other, not of shape {rows.shape}")
    return rows


def read_only(array: ArrayLike) -> FloatArray:
    """View of an array that cannot be written to."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def array_with_dimensions(size: int) -> Callable[[str, Any], FloatArray]:
    """A check for a float array of so many dimensions."""

    def check_dimensions(name, value):
        array = float_array(name, value, finite=False)
        if array.ndim != size:
            raise ParameterError(f"{name} must have {size} dimension{'s' * (size > 1)}, not shape {array.shape}")
        return array

    return check_dimensions
