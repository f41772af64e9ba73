"""Results as tables, and back: ECSV or FITS, every bit of every number, readable by astropy alone.

What does not fit into columns stands as JSON under RESULT in the metadata: FITS headers keep
neither all digits of a number nor letters beyond ASCII.

Each kind of result says itself how it is packed; this file knows none of them by name. A file is
checked as strictly as a field is: what was written is what comes back, or an error that says what is wrong.
"""

from __future__ import annotations

import json
import re
from dataclasses import fields
from html import escape
from importlib import import_module
from typing import Any, cast

import numpy as np

from fit.storage._plain import decoded, encoded, same
from vsh import tables
from vsh.checks.frozen import Frozen
from vsh.checks.notes import printable
from vsh.checks.types import PathName, Table
from vsh.errors import TableError, VshError

#: Kinds of results whose modules have been imported, by name.
_KINDS: dict[str, type[Result]] = {}
#: A file names the module of its kind; none but ours is ever imported.
_OURS = re.compile(r"fit(\.\w+)+")


class Result(Frozen):
    """What every result can do: report, table, figure, file, notebook.

    A class gives `report()`, `plot()` and, where its arrays are not its table, `to_table()`. It is packed
    attribute by attribute unless it says otherwise: `_pack()` → (columns, the rest as plain values, units of
    columns) and the class method `_unpack(columns, rest)`, which may raise anything on what is not right.
    """

    def report(self) -> str:
        """The result as text."""
        raise NotImplementedError

    def plot(self, *, ax: Any = None) -> Any:
        """The result on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        raise NotImplementedError

    def to_table(self) -> Table:
        """The result as an astropy Table: the columns that `write` writes."""
        columns, _, units = self._pack()
        return tables.table_of(columns, self._plain_facts(), units)

    def _repr_html_(self) -> str:
        """The report, for a notebook."""
        return f"<pre>{escape(self.report())}</pre>"

    def _plain_facts(self):
        """What any reader of the table should see in its header."""
        facts = {"frame": getattr(self, "frame", None), "n_data": getattr(self, "n_data", None)}
        return {key: value for key, value in facts.items() if isinstance(value, str | int)}

    def _pack(self):
        table = type(self).to_table(self)
        columns = {name: np.asarray(table[name]) for name in table.colnames}
        units = {name: str(table[name].unit) for name in table.colnames if table[name].unit is not None}
        return (
            columns,
            {"fields": {each.name: encoded(getattr(self, each.name)) for each in fields(cast(Any, self))}},
            units,
        )

    @classmethod
    def _unpack(cls, columns, rest):
        return cls(**{each.name: decoded(rest["fields"][each.name]) for each in fields(cast(Any, cls))})

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        _KINDS[cls.__name__] = cls

    def write(self, path: PathName, meta: dict[str, Any] | None = None) -> None:
        """Write to an ECSV or FITS file, which takes its name when it is complete.

        Parameters
        ----------
        path : str or Path
            The file.
        meta : dict, optional
            Provenance, plain values.

        Raises
        ------
        TableError
            If the name ends otherwise.
        """
        _check_format(path)
        columns, rest, units = self._pack()
        mark = json.dumps({"type": type(self).__name__, "module": type(self).__module__} | rest)
        plain = self._plain_facts()
        if getattr(self, "notes", None) and tables.format_of(path) == "ascii.ecsv":  # a FITS header has no lists
            plain["notes"] = list(map(str, getattr(self, "notes", ())))
        tables.write(path, columns, plain | (meta or {}) | {"RESULT": mark}, units)

    @classmethod
    def read(cls, path: PathName) -> Any:
        """Read what `write` wrote, bit for bit.

        Parameters
        ----------
        path : str or Path
            An ECSV or FITS file.

        Raises
        ------
        TableError
            If the file holds no result, one of another kind, or one that is not as it was written.
        """
        found = read(path)
        if not isinstance(found, cls):
            raise TableError(
                f"{printable(path)} holds a {type(found).__name__}, not a {cls.__name__}: fit.storage.read takes either"
            )
        return found

    def __eq__(self, other: object) -> bool:
        """Whether two results are of one kind and the same in every number."""
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, each.name), getattr(other, each.name)) for each in fields(cast(Any, self)))

    def __hash__(self) -> int:
        return hash((type(self).__name__, repr(self)))


def read(path: PathName) -> Any:
    """Read any result that was written to a file.

    Parameters
    ----------
    path : str or Path
        An ECSV or FITS file.

    Raises
    ------
    TableError
        If the file holds none, or one that is not as it was written.
    """
    _check_format(path)
    table, shown = tables.read(path), printable(path)
    try:
        rest = json.loads({key.upper(): value for key, value in table.meta.items()}["RESULT"])
        kind, module = str(rest.pop("type")), str(rest.pop("module"))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, ImportError):
        raise TableError(f"{shown} holds no result of a fit: it lacks its mark, RESULT, in the metadata") from None
    try:
        home = _kind(kind, module)
    except (KeyError, ImportError):
        raise TableError(
            f"{shown} holds a {printable(kind)} of the module {printable(module)}, which is not known here: import it first"
        ) from None
    try:
        columns = {name: _native(name, table[name]) for name in table.colnames}
        found = home._unpack(columns, rest)
        _check_same(found, columns, table)
    except (VshError, KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise TableError(
            f"{shown} is damaged: its {kind} is not as it was written ({printable(what)[:300]})"
        ) from error
    return found


def _kind(name, module):
    if name not in _KINDS and _OURS.fullmatch(module):
        import_module(module)
    return _KINDS[name]


def _check_same(found, columns, table):
    """Packed again, the result must give the columns that were read, in their order and units."""
    again, _, units = found._pack()
    if set(again) != set(columns):
        raise TableError(f"columns {', '.join(sorted(set(again) ^ set(columns)))}")
    for name, values in again.items():
        if not same(np.asarray(values).astype(columns[name].dtype), columns[name]):
            raise TableError(f"column {name} does not go with the others")
        unit = table[name].unit
        wanted = units.get(name)
        if (unit is None) != (wanted is None) or (wanted is not None and unit != _unit(wanted)):
            raise TableError(f"column {name} is in {unit}, not in {wanted}")


def _unit(text):
    from astropy.units import Unit

    return Unit(text)


def _check_format(path):
    name = str(path).lower().removesuffix(".gz")
    if not name.endswith((".ecsv", ".fits", ".fit")):
        raise TableError(f"{printable(path)}: results are written as .ecsv or .fits, which keep every bit")


def _native(name, column):
    if np.any(getattr(column, "mask", False)):
        raise TableError(f"{np.sum(column.mask)} values of column {name} are missing")
    array = np.asarray(column)
    return array.astype(array.dtype.newbyteorder("=")) if array.dtype.kind in "fi" else array.astype(str)
