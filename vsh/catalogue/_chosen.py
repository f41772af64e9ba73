"""The rows of a table that a condition selects, by their numbers, and how many it does not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vsh import tables
from vsh.checks.notes import FALSE, MISSING, NotSelected
from vsh.errors import NothingSelectedError


class Chosen:
    """A condition on one table.

    Parameters
    ----------
    where : str
        The condition, as for `vsh.tables.Where`.
    source : TableSource
        The table.
    roles : dict of str to str, optional
        Columns by role.

    Attributes
    ----------
    names : tuple of str
        Of the columns it looks at.

    Raises
    ------
    TableError
        If it is no condition, or the table has not all of its columns.
    """

    def __init__(self, where: str, source: tables.TableSource, roles: Mapping[str, str] | None = None) -> None:
        self._where = tables.Where(where)
        # A role stands for the column that has it, where no column is called so: redshift for redshift_qsoc.
        self._roles = {
            name: (roles or {})[name]
            for name in self._where.names
            if name not in source.names and name in (roles or {})
        }
        self._where.check((*source.names, *self._roles), source.label)
        self.names = tuple(dict.fromkeys(self._roles.get(name, name) for name in self._where.names))

    def of(self, block: Mapping[str, Any], first_row: int) -> tuple[dict[str, Any], Any, list[str]]:
        """The selected rows of a block, their numbers, and a note that counts the others."""
        read = {name: block[self._roles.get(name, name)] for name in self._where.names}
        selected, unknown = self._where.rows(read or block)
        counts = {FALSE: int((~selected & ~unknown).sum()), MISSING: int(unknown.sum())}
        counts = {why: count for why, count in counts.items() if count}
        mark = [
            np.packbits(selected),
            np.array([first_row]),
            *(np.asarray(each) for each, _ in list(block.values())[:2]),
        ]
        note = NotSelected.of_table(counts, len(selected), *mark, names=(self._where.shown,))
        if not selected.any():
            raise nothing_selected((note,))
        rows = np.flatnonzero(selected)
        kept = {
            name: (values[rows], None if mask is None else np.asarray(mask)[rows])
            for name, (values, mask) in block.items()
        }
        return kept, first_row + rows, [note]


def nothing_selected(notes: Iterable[str]) -> NothingSelectedError:
    """The error of a table without a selected row."""
    error = NothingSelectedError("no row is left by --where: " + "; ".join(map(str, notes)))
    error.notes = tuple(notes)
    return error
