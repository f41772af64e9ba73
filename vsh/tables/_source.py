"""A table that is open: the columns it has, and its rows in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vsh.checks.notebook import InNotebook
from vsh.checks.types import Table
from vsh.errors import TableError

#: Rows in a block where nobody asked for a number.
ROWS = 2**20


@dataclass(frozen=True)
class TableSource(InNotebook):
    """What every format opens as; nothing but the columns that are asked for is read.

    Attributes
    ----------
    label : str
        Of the file or object, for messages.
    names : tuple of str
        Of the columns.
    read : function
        From (names, rows) to an iterator of dicts: column → (values, mask or None), at most `rows`
        rows in each, at least one dict.
    units : dict of str to str or unit
        Of those columns that say theirs.
    meta : dict
    notes : tuple of str
        What a user should know of how the table was read.
    descriptions : dict of str to str
        Of those columns that have one.
    whole : int
        Rows in a block where all are read at once: fewer where a block takes more memory than its numbers do.
    """

    label: str
    names: tuple[str, ...]
    read: Callable
    units: dict = field(default_factory=dict)
    meta: dict = field(default_factory=dict)
    notes: tuple = ()
    whole: int = ROWS
    descriptions: dict = field(default_factory=dict)

    def blocks(self, names: Sequence[str] | None = None, rows: int = ROWS) -> Iterator[dict[str, Any]]:
        """Some columns in blocks of at most `rows` rows: dicts of (values, mask or None)."""
        wanted = tuple(self.names if names is None else names)
        # astropy keeps a mask that a format cannot hold as a column of its own beside the values.
        masks = tuple(f"{name}.mask" for name in wanted if f"{name}.mask" in self.names)
        for block in self.read(tuple(dict.fromkeys(wanted + masks)), rows):
            yield {name: _with_mask(block, name) for name in wanted}

    def columns(self, names: Sequence[str] | None = None) -> dict[str, Any]:
        """Some columns whole, a dict of (values, mask or None); all of them unless named."""
        parts = list(self.blocks(names, self.whole))
        if len(parts) == 1:
            return parts[0]
        return {name: _joined([part[name] for part in parts]) for name in parts[0]}

    def to_table(self) -> Table:
        """The whole as an astropy Table."""
        from astropy.table import Column, MaskedColumn, Table

        names = [name for name in self.names if not (name.endswith(".mask") and name[:-5] in self.names)]
        table = Table(meta=dict(self.meta))
        for name, (values, mask) in self.columns(names).items():
            unit = self.units.get(name)
            masked = mask is not None and mask.any()
            table[name] = MaskedColumn(values, mask=mask, unit=unit) if masked else Column(values, unit=unit)
        return table


def chained(label: str, sources: Sequence[TableSource]) -> TableSource:
    """Several tables with the same columns, one after the other, as one."""
    first = sources[0]

    def read(names, rows):
        for source in sources:
            check_alike(source, first.label, {name: str(first.units.get(name)) for name in names})
            yield from source.read(names, rows)

    notes = tuple(dict.fromkeys(note for source in sources for note in source.notes))
    return TableSource(label, first.names, read, first.units, first.meta, notes, descriptions=first.descriptions)


def check_alike(source: TableSource, label: str, units: Mapping[str, str]) -> None:
    """Raise TableError unless a table has the columns of another, in its units."""
    missing = [name for name in units if name not in source.names]
    if missing:
        raise TableError(f"{source.label} has no column {', '.join(missing)}, which {label} has")
    for name, unit in units.items():
        if str(source.units.get(name)) != unit:
            raise TableError(f"{source.label} has {name} in {source.units.get(name)}, {label} in {unit}")


def _with_mask(block, name):
    values, mask = block[name]
    if f"{name}.mask" not in block:
        return values, mask
    further = np.asarray(block[f"{name}.mask"][0], bool)
    return values, further if mask is None else mask | further


def _joined(parts):
    values = np.concatenate([values for values, _ in parts])
    if all(mask is None for _, mask in parts):
        return values, None
    return values, np.concatenate([np.zeros(len(v), bool) if mask is None else mask for v, mask in parts])
