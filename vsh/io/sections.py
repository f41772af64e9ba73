"""The lines to quote and the sections of a result, from which text, page, LaTeX, JSON and files are made.

A table is printed as a reader wants it: a value with its error in one cell, digits by the error, units in the head.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vsh.tools.digits import format_cell, format_p_value, format_to_error_digits, format_with_error
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import format_labelled_lines, printable
from vsh.tools.types import Table

__all__ = ["Answer", "Section", "text_of"]

#: Numbers beside a value that are known as well as it is.
_PREFIXES_OF_NUMBERS = ("median", "mean", "truth", "low", "high", "above", "below")
_MANY = re.compile(r" / \(([^()]*)\)")


def format_table(
    table: Table,
    forms: Mapping[str, str] | None = None,
    *,
    write_name: Callable[[str], str] | None = None,
    digits: int = 4,
) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of text: `value` and `sigma`, or `x` and `x_error`, are one cell with two digits of the error.

    Parameters
    ----------
    table : Table
        Any.
    forms : dict of str to str, optional
        Formats of columns, by name.
    write_name : callable, optional
        How the name of a column is written: in words unless given.
    digits : int
        How many digits a number without an error has.

    Returns
    -------
    heads : list of str
        Names with units, if there are any.
    rows : list of list of str
        As many cells each.
    """
    table, patterns = table.copy(), ("{}_error", "sigma_{}")
    for column in table.itercols():
        if column.unit == "rad":  # read in degrees
            column.convert_unit_to("deg")
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
        if name in errors:
            cells = [format_with_error(*pair) for pair in zip(values, table[errors[name]].tolist(), strict=True)]
        elif number_format := (forms or {}).get(name):
            cells = [format(value, number_format) for value in values]
        elif name.startswith("p_value"):
            cells = list(map(format_p_value, values))
        elif name == "unit":
            cells = list(map(format_unit, values))
        elif name.startswith("correlation_"):
            cells = [f"{value:+.3f}" for value in values]
        elif (name.startswith(_PREFIXES_OF_NUMBERS) and "sigma" in table.colnames) or name == "sigma":
            cells = [format_to_error_digits(*pair) for pair in zip(values, table["sigma"].tolist(), strict=True)]
        else:
            cells = [format_cell(value, digits) for value in values]
        words = f"r({name.removeprefix('correlation_')})" if name.startswith("correlation_") else name.replace("_", " ")
        head = words if write_name is None else write_name(name)
        heads.append(f"{head} [{format_unit(unit)}]" if unit else head)
        columns.append(cells)
    return heads, [list(row) for row in zip(*columns, strict=True)]


def format_unit(unit: Any) -> str:
    """Format a unit as a report has it: µas/yr, km/s/Mpc."""
    if str(unit) == "uas2 / yr2":
        return "(µas/yr)²"
    return _MANY.sub(lambda m: "/" + "/".join(m[1].split()), str(unit).replace("uas", "µas")).replace(" / ", "/")


@dataclass(frozen=True)
class Answer:
    """The lines to quote of a result.

    Attributes
    ----------
    lines : tuple of (str, str)
        Labels with their text: acceleration, spin, the distance from Gaia EDR3's acceleration, and what the errors
        are, which comes first where it is not the fit to quote. None where the fit is not of proper motions.

    Examples
    --------
    >>> answer = Answer((("acceleration", "not detected"), ("spin", "not detected")))
    >>> print(answer)
    acceleration   not detected
    spin           not detected
    >>> answer.sentence
    'acceleration not detected; spin not detected'
    """

    lines: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        # Screen, file and page alike: no name of a source may be a terminal's escape.
        object.__setattr__(self, "lines", tuple((printable(label), printable(text)) for label, text in self.lines))

    def __str__(self) -> str:
        return format_labelled_lines(self.lines)

    @property
    def sentence(self) -> str:
        """All lines as one."""
        return "; ".join(f"{label} {text}" for label, text in self.lines)


@dataclass(frozen=True, eq=False)
class Section(InNotebook):
    """A section of a result.

    Attributes
    ----------
    title : str
        What it is about, in one line.
    facts : sequence of (str, str)
        Labels with the words that belong to them, above the table.
    table : Table or None
        Rows and columns with their units; the error of a column `x` is `x_error` or `sigma_x`, that of `value` is
        `sigma`. Files and JSON have all of it.
    columns : sequence of str
        The columns that text and page show; all unless given.
    rows : sequence of int, optional
        The rows that the text shows, in their order; all unless given.
    forms : dict of str to str
        How numbers of a column are printed where their errors do not say it: `{"value": ".3f"}`.
    remarks : sequence of str
        Sentences below the table.
    notes : sequence of str
        What the reader should know of the data.

    Examples
    --------
    >>> from astropy.table import Table
    >>> table = Table({"degree": [1, 2], "power": [5.0, 3.0], "power_error": [0.5, 0.5]})
    >>> print(Section("Power by degree", [("sources", "713")], table))
    Power by degree
    sources        713
      degree         power
           1   5.00 ± 0.50
           2   3.00 ± 0.50
    """

    title: str
    facts: Sequence[tuple[str, str]] = ()
    table: Table | None = None
    columns: Sequence[str] = ()
    rows: Sequence[int] | None = None
    forms: Mapping[str, str] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    notes: Sequence[Any] = ()

    def __str__(self) -> str:
        lines = [self.title]
        if self.facts:
            lines.append(format_labelled_lines(self.facts))
        if self.shown is not None:
            lines += format_table_lines(*format_table(self.shown, self.forms))
        lines += self.remarks
        if self.notes:
            lines += ["", "Notes", *(f"  - {note}" for note in dict.fromkeys(map(str, self.notes)))]
        return "\n".join(lines)

    @property
    def shown(self) -> Table | None:
        """The part of the table that the text shows."""
        if self.table is None:
            return None
        table = self.table[list(self.columns)] if self.columns else self.table
        return table if self.rows is None else table[np.asarray(self.rows, int)]


def text_of(sections: Iterable[Section]) -> str:
    """Text of sections, an empty line between them.

    Parameters
    ----------
    sections : iterable of Section
        In their order.
    """
    return "\n\n".join(map(str, sections)) + "\n"


def format_table_lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: words to the left, numbers to the right, two spaces before the first column."""
    columns = list(zip(heads, *rows, strict=True))
    alignments = ["<" if any(cell[:1].isalpha() for cell in column[1:]) else ">" for column in columns]
    formats = [f"{alignment}{max(map(len, column))}" for alignment, column in zip(alignments, columns, strict=True)]
    return [f"  {'   '.join(map(format, cells, formats))}".rstrip() for cells in (heads, *rows)]


def as_json_value(value: Any) -> Any:
    """A value made of what JSON knows: tables by column with their units, numbers that are not finite as None.

    Parameters
    ----------
    value : anything
        Mappings, sequences, arrays, numbers, astropy Tables; whatever else becomes text.
    """
    if hasattr(value, "colnames"):
        columns = {
            name: {"unit": None if value[name].unit is None else str(value[name].unit), "values": value[name].tolist()}
            for name in value.colnames
        }
        return as_json_value({"meta": dict(value.meta), "columns": columns})
    if isinstance(value, Mapping):
        return {str(key): as_json_value(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.number | np.bool_):
        return as_json_value(value.tolist())
    if isinstance(value, (list, tuple)):
        return [as_json_value(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)
