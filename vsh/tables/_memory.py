"""Tables in memory: astropy's, pandas' with every class made from it, dicts and structured arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.errors import TableError, first_line
from vsh.tables._source import TableSource


def open_astropy(table: Any) -> TableSource:
    """An astropy Table or QTable."""
    names = tuple(table.colnames)
    units = {name: table[name].unit for name in names if getattr(table[name], "unit", None) is not None}

    def read(wanted, rows):
        for start in range(0, max(1, len(table)), rows):
            yield {name: _column(table[name][start : start + rows]) for name in wanted}

    said = {name: table[name].description for name in names if getattr(table[name], "description", None)}
    return TableSource("the table", names, read, units, dict(table.meta), descriptions=said)


def open_frame(frame: Any) -> TableSource:
    """A pandas DataFrame, or an object of a class made from it (geopandas, LSDB's NestedFrame)."""
    names = tuple(map(str, frame.columns))
    if len(set(names)) < len(names):
        raise TableError(f"the table has several columns of one name: {', '.join(names)}")
    at = dict(zip(names, range(len(names)), strict=True))

    def read(wanted, rows):
        for start in range(0, max(1, len(frame)), rows):
            yield {name: _series(frame.iloc[start : start + rows, at[name]], name) for name in wanted}

    meta = {str(key): value for key, value in getattr(frame, "attrs", {}).items()}
    return TableSource("the table", names, read, {}, meta)


def open_other(thing: Any) -> TableSource:
    """A dict of columns or a structured array."""
    from astropy.table import Table

    if isinstance(thing, (int, float, complex, bytes)) or thing is None:
        raise TableError(f"a {type(thing).__name__} is no table")
    try:
        return open_astropy(Table(thing))
    except Exception as error:  # whatever astropy makes of what is no table
        raise TableError(f"a {type(thing).__name__} is no table: {first_line(error)}") from error


def is_frame(thing: Any) -> bool:
    """Whether an object is pandas' DataFrame or made from it; pandas need not be installed."""
    return any(c.__name__ == "DataFrame" and c.__module__.split(".")[0] == "pandas" for c in type(thing).__mro__)


def _column(column):
    mask = getattr(column, "mask", None)
    values = getattr(column, "unmasked", column)
    values = getattr(values, "value", values)
    mask = None if mask is None or not np.any(mask) else np.array(np.broadcast_to(mask, np.shape(column)))
    return np.asarray(np.ma.getdata(values)), mask


def _series(series, name):
    mask = series.isna().to_numpy()
    if isinstance(series.dtype, np.dtype) and series.dtype.kind == "f":
        return series.to_numpy(), None  # a nan is not finite, as in every format
    kind = series.dtype.kind
    try:
        if isinstance(series.dtype, np.dtype) and kind != "O":
            values = series.to_numpy()
        elif kind in "iu":
            values = series.to_numpy(dtype=f"{kind}8", na_value=0)
        elif kind == "f":
            values = series.to_numpy(dtype="f8", na_value=np.nan)
        elif kind == "b":
            values = series.to_numpy(dtype=bool, na_value=False)
        else:
            values = series.to_numpy(dtype=object)
            if all(isinstance(each, str) for each in values[~mask]):
                values = np.array(np.where(mask, "", values), dtype=str)
    except (TypeError, ValueError) as error:
        raise TableError(f"column {name!r} cannot be read: {first_line(error)}") from error
    return values, mask if mask.any() else None
