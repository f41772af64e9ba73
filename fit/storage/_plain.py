"""Values as plain JSON and back, every bit of them."""

from __future__ import annotations

import base64
import re
import zlib
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np

from vsh.errors import TableError
from vsh.modes import Modes


def same(one: Any, two: Any) -> bool:
    """Whether two values, arrays and sequences of them among them, are equal; nan equals nan."""
    if isinstance(one, np.ndarray) or isinstance(two, np.ndarray):
        one, two = np.asarray(one), np.asarray(two)
        return one.shape == two.shape and np.array_equal(one, two, equal_nan=one.dtype.kind == "f")
    if isinstance(one, (list, tuple)) and isinstance(two, (list, tuple)):
        return (
            getattr(one, "_fields", None) == getattr(two, "_fields", None)
            and len(one) == len(two)
            and all(map(same, one, two))
        )
    if isinstance(one, float) and isinstance(two, float) and np.isnan(one):
        return bool(np.isnan(two))
    if is_dataclass(one) and not isinstance(one, type) and type(one) is type(two):
        return all(same(getattr(one, each.name), getattr(two, each.name)) for each in fields(one))
    return bool(one == two)


def encoded(value: Any) -> Any:
    """A value as plain JSON, every bit of it: arrays as compressed bytes, results and nouns by their attributes."""
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"))
        data = base64.b85encode(zlib.compress(array.tobytes(), 6)).decode()
        return {"array": data, "kind": array.dtype.str, "shape": list(array.shape)}
    if type(value).__module__.split(".")[0] in ("fit", "vsh") and (is_dataclass(value) or hasattr(value, "_fields")):
        about = {"type": type(value).__name__, "module": type(value).__module__}
        return about | {"fields": {name: encoded(getattr(value, name)) for name in _attributes(type(value))}}
    if isinstance(value, (bool, int, np.integer)) or value is None:
        return value if value is None or isinstance(value, (bool, int)) else int(value)
    if isinstance(value, (float, np.floating)):
        return {"float": exact(float(value))}
    if isinstance(value, dict):
        return {"dict": [[encoded(key), encoded(each)] for key, each in value.items()]}
    if isinstance(value, (list, tuple)):
        return {"list" if isinstance(value, list) else "tuple": [encoded(each) for each in value]}
    return str(value)


def _attributes(kind):
    """Names of what a dataclass or a NamedTuple is made with; None for anything else."""
    if is_dataclass(kind):
        return [each.name for each in fields(kind)]
    return (
        list(kind._fields) if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields") else None
    )


def decoded(plain: Any) -> Any:
    """What `encoded` wrote."""
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        kind = np.dtype(plain["kind"])
        shape = tuple(count(size) for size in plain["shape"])
        if kind.hasobject or kind.itemsize * int(np.prod(shape, dtype=float)) > 2**34:
            raise TableError("an array")
        size = kind.itemsize * int(np.prod(shape))
        try:
            data = zlib.decompressobj().decompress(base64.b85decode(plain["array"]), size + 1)
        except zlib.error as error:
            raise TableError(f"an array ({error})") from None
        if len(data) != size:
            raise TableError("the size of an array")
        array = np.frombuffer(data, kind).reshape(shape)
        return array.astype(kind.newbyteorder("="))
    if "float" in plain:
        return number(plain["float"])
    if "dict" in plain:
        return {decoded(key): decoded(each) for key, each in plain["dict"]}
    if "list" in plain:
        return [decoded(each) for each in plain["list"]]
    if "tuple" in plain:
        return tuple(decoded(each) for each in plain["tuple"])
    if not re.fullmatch(r"(fit|vsh)(\.\w+)+", plain["module"]):
        raise TableError(f"a {plain['type']}")
    try:
        home: Any = getattr(import_module(plain["module"]), plain["type"])
    except (ImportError, AttributeError):
        raise TableError(f"a {plain['type']}") from None
    if _attributes(home) is None:
        raise TableError(f"a {plain['type']}")
    return home(**{name: decoded(each) for name, each in plain["fields"].items()})


def coefficient_columns(modes: Modes) -> dict[str, list[Any]]:
    """The columns that name each coefficient."""
    each = list(modes)
    return {
        "coefficient": [str(mode) for mode in each], "kind": [mode.kind for mode in each],
        "l": [mode.l for mode in each], "m": [mode.m for mode in each], "part": [mode.part or "-" for mode in each],
    }  # fmt: skip


def exact(x: Any) -> str:
    """A number in hexadecimal: every bit, nan and inf among them."""
    return float(x).hex()


def number(text: Any) -> Any:
    """What `exact` wrote, as a number; anything else as it is."""
    return float.fromhex(text) if isinstance(text, str) else text


def words(values: Any) -> tuple[str, ...]:
    """A list of strings, checked, as a tuple."""
    if not isinstance(values, list) or not all(isinstance(each, str) for each in values):
        raise TableError(f"{values!r} is no list of words")
    return tuple(values)


def count(value: Any) -> int:
    """A whole number of at least zero, checked."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise TableError(f"{value!r} is no count")
    return value
