"""Columns of arrays as one matrix each, from every container of tables: lists, masked arrays, words of JSON."""

import json
from typing import Any

import numpy as np

from vsh.tools.errors import TableError
from vsh.tools.types import BoolArray

#: How truth is written in words.
_TRUTH = {"true": True, "t": True, "yes": True, "false": False, "f": False, "no": False}
#: A field that stands for nothing.
_NOTHING = ("", "null", "none", "nan", "--", "na", "<na>")


def matrix_of(values: Any, mask: Any, name: str, label: str) -> tuple[Any, BoolArray | None, BoolArray | None]:
    """Turn a column into numbers: (n,), or (n, k) where a row holds several, shorter rows padded.

    Parameters
    ----------
    values : (n,) or (n, k) array
        Numbers; or objects: lists, tuples, (masked) arrays, None, one number each; or text: numbers, words for truth,
        or lists in JSON, as ECSV keeps arrays of any length.
    mask : (n,) or (n, k) bool array or None
        What is missing.
    name, label : str
        The column and the table, for messages.

    Returns
    -------
    values : array
        Numbers or bools.
    mask : bool array or None
        What is missing, of the same shape.
    padding : (n, k) bool array or None
        Where a row had no entry: not a missing value, but none at all.

    Raises
    ------
    TableError
        If an entry is no number.
    """
    values = np.asarray(values)
    if values.dtype.kind in "iufb":
        return values, None if mask is None else _spread(mask, values.shape), None
    missing = (
        np.zeros(len(values), bool) if mask is None else np.asarray(mask, bool).reshape(len(values), -1).all(axis=1)
    )
    if values.dtype.kind in "SU":
        words = np.char.decode(values, "utf-8", "replace") if values.dtype.kind == "S" else values
        entries = [_of_text(each, name, label) for each in words]
    elif values.dtype.kind == "O" and values.ndim == 1:
        entries = list(values)
    else:
        raise TableError(f"{label}: column {name!r} holds {values.dtype.name}, not numbers")
    missing = missing | np.array([entry is None for entry in entries], bool)
    entries = [None if gone else entry for gone, entry in zip(missing, entries, strict=True)]
    if all(entry is None or np.ndim(entry) == 0 for entry in entries):
        numbers, lost = _numbers(entries, name, label)
        return numbers, lost if lost.any() else None, None
    rows = [_row(entry) for entry in entries]
    lengths = np.array([len(row) for row in rows])
    inside = np.arange(lengths.max()) < lengths[:, None]
    filled = [row for row in rows if len(row)]
    if all(row.dtype.kind in "iufb" for row in filled) and len({row.dtype.kind for row in filled}) == 1:
        flat = np.concatenate([row.data for row in filled])
        lost = np.concatenate([np.ma.getmaskarray(row) for row in filled])
    else:
        flat, lost = _numbers([x for row in filled for x in _listed(row)], name, label)
    matrix, absent = np.zeros(inside.shape, flat.dtype), np.zeros(inside.shape, bool)
    matrix[inside], absent[inside] = flat, lost
    # A row without a list, as of a transit whose arrays are null, is missing and no padding.
    absent[missing] = True
    padding = ~inside & ~missing[:, None]
    return matrix, absent if absent.any() else None, padding if padding.any() else None


def _spread(mask, shape):
    """A mask of rows, or of every number, in the shape of the values."""
    mask = np.asarray(mask, bool)
    return np.broadcast_to(mask.reshape(mask.shape + (1,) * (len(shape) - mask.ndim)), shape)


def _row(entry):
    """One row's entries as a masked array; none of None."""
    if entry is None:
        return np.ma.array(np.zeros(0))
    return np.ma.atleast_1d(np.ma.asarray(entry)).ravel()


def _listed(row):
    """The entries of a row, None where they are masked."""
    return [None if gone else x for x, gone in zip(row.data.tolist(), np.ma.getmaskarray(row), strict=True)]


def _numbers(entries, name, label):
    """Numbers or bools of a list of them, and where there is none; integers keep all their digits."""
    lost = np.array([_is_nothing(each) for each in entries], bool)
    some = [_parsed(each) for each, gone in zip(entries, lost, strict=True) if not gone]
    kinds = {"b" if isinstance(each, (bool, np.bool_)) else np.asarray(each).dtype.kind for each in some}
    if not kinds <= set("iufb"):
        wrong = next(each for each in some if np.asarray(each).dtype.kind not in "iufb")
        raise TableError(f"{label}: column {name!r} holds {wrong!r}, which is no number")
    dtype: Any = bool if kinds == {"b"} else np.int64 if kinds <= set("iu") and kinds else float
    numbers = np.zeros(len(entries), dtype)
    if dtype is float:
        numbers[lost] = np.nan
    numbers[~lost] = np.array(some, dtype) if some else numbers[~lost]
    return numbers, lost


def _is_nothing(entry):
    if entry is None or entry is np.ma.masked or type(entry).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(entry, str) and entry.strip().lower() in _NOTHING


def _parsed(entry):
    """A number of a word."""
    if not isinstance(entry, str):
        return entry
    word = entry.strip().lower()
    if word in _TRUTH:
        return _TRUTH[word]
    try:
        return int(word)
    except ValueError:
        try:
            return float(word)
        except ValueError:
            return entry


def _of_text(text, name, label):
    """A word, or the list that it writes out."""
    text = str(text).strip()
    if not text.startswith(("[", "(", "{")):
        return text
    inner = "[" + text[1:-1] + "]"
    try:
        return json.loads(inner.replace("True", "true").replace("False", "false").replace("None", "null"))
    except ValueError:
        if "," not in inner:  # as NumPy prints arrays
            return inner[1:-1].split()
        raise TableError(f"{label}: column {name!r} holds {text[:40]!r}, which is no list of numbers") from None
