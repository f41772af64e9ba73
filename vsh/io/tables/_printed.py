"""A table as a reader wants it printed: a value with its error in one cell, digits by the error, units in the head."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from vsh.tools.types import Table

#: Numbers beside a value that are known as well as it is.
_ALIKE = ("median", "mean", "truth", "low", "high", "above", "below")
_MANY = re.compile(r" / \(([^()]*)\)")


def two_digits(sigma: Any) -> int:
    """Decimals by which the smallest error has two digits, 0 to 6."""
    least = np.min(sigma)
    return int(np.clip(1 - np.floor(np.log10(least)), 0, 6)) if least > 0 and np.isfinite(least) else 3


def three_digits(value: float) -> str:
    """Three digits at least, and no power of ten for what is large."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def printed(table: Table, forms: Mapping[str, str] | None = None) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of text: `value` and `sigma`, or `x` and `x_error`, are one cell with two digits of the error.

    Parameters
    ----------
    table : Table
        Any.
    forms : dict of str to str, optional
        Formats of columns, by name.

    Returns
    -------
    heads : list of str
        Names with units, if there are any.
    rows : list of list of str
        As many cells each.
    """
    patterns = ("{}_error", "sigma_{}")
    errors = {
        name: item.format(name) for name in table.colnames for item in patterns if item.format(name) in table.colnames
    }
    if {"value", "sigma"} <= set(table.colnames):
        errors["value"] = "sigma"
    heads, columns = [], []
    for name in table.colnames:
        if name in errors.values():
            continue
        unit, values = table[name].unit, table[name].tolist()
        if unit == "rad":  # read in degrees
            unit, values = "deg", np.degrees(values).tolist()
        if (form := (forms or {}).get(name)) and name in errors:
            pairs = zip(values, table[errors[name]].tolist(), strict=True)
            cells = [f"{value:{form}} ± {error:{form.lstrip('+')}}" for value, error in pairs]
        elif form:
            cells = [format(item, form) for item in values]
        elif name in errors:
            cells = [_with_error(*item) for item in zip(values, table[errors[name]].tolist(), strict=True)]
        elif name.startswith("p_value"):
            cells = list(map(printed_p_value, values))
        elif name == "unit":
            cells = list(map(unit_words, values))
        elif name.startswith("correlation_"):
            cells = [f"{item:+.3f}" for item in values]
        elif (name.startswith(_ALIKE) and "sigma" in table.colnames) or name == "sigma":
            cells = [_round_to_error(*item) for item in zip(values, table["sigma"].tolist(), strict=True)]
        else:
            cells = list(map(cell, values))
        head = f"r({name.removeprefix('correlation_')})" if name.startswith("correlation_") else name.replace("_", " ")
        heads.append(f"{head} [{unit_words(unit)}]" if unit else head)
        columns.append(cells)
    return heads, [list(row) for row in zip(*columns, strict=True)]


def printed_p_value(p: float) -> str:
    """A probability as it is printed."""
    return f"{p:.4f}" if p > 1e-3 else f"{p:.1e}" if p > 0 else "<1e-300" if p == 0 else "–"


def cell(value: Any) -> str:
    """A value of a table as text: numbers to five digits."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{value:.5g}" if np.isfinite(value) else "–"
    return "" if value is None else str(value)


def _with_error(value, error):
    if not (isinstance(value, float) and isinstance(error, float) and np.isfinite(value) and error > 0):
        return _round_to_error(value, error)
    if not 1e-6 < error < 1e6:
        return f"{value:.5g} ± {error:.2g}"
    digits = two_digits(error)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _round_to_error(value, error):
    has_error = isinstance(value, float) and isinstance(error, float) and np.isfinite(value) and 1e-6 < error < 1e6
    return f"{value:.{two_digits(error)}f}" if has_error else cell(value)


def unit_words(unit: Any) -> str:
    """A unit as a report has it: µas/yr, km/s/Mpc."""
    if str(unit) == "uas2 / yr2":
        return "(µas/yr)²"
    return _MANY.sub(lambda m: "/" + "/".join(m[1].split()), str(unit).replace("uas", "µas")).replace(" / ", "/")
