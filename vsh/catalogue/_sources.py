"""Catalogues of which only positions, and perhaps errors, are wanted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vsh import tables
from vsh.catalogue._columns import Columns, as_columns
from vsh.catalogue._icrf import open_icrf
from vsh.catalogue._read import read_field
from vsh.checks.arguments import positive
from vsh.checks.types import OnBad
from vsh.field import Field

_MOTIONS = ("pmra", "pmdec")
_ERRORS = ("pmra_error", "pmdec_error")


def read_sources(
    source: Any,
    columns: Columns | Mapping[str, str] | str | None = None,
    units: Mapping[str, Any] | None = None,
    *,
    on_bad: OnBad = "raise",
    sigma: float | None = None,
    frame: str | None = None,
    where: str | None = None,
    format: str | None = None,
) -> Field:
    """Read positions and errors; what the table lacks of motions is zero."""
    opened, chosen, said = without_motions(open_icrf(source, format), as_columns(columns), sigma)
    return read_field(opened, chosen, units, on_bad=on_bad, frame=frame, where=where).add_note(*said)


def without_motions(
    opened: tables.TableSource, wanted: Columns, sigma: float | None = None
) -> tuple[tables.TableSource, Columns, tuple[str, ...]]:
    """A table with zeros for the motions that it lacks, and errors where it has none: table, its columns, and notes."""
    absent = {role for role in (*_MOTIONS, *_ERRORS) if getattr(wanted, role) not in opened.names}
    replaced = {
        role: 0.0 for role in _MOTIONS if absent >= set(_MOTIONS)
    }  # one of two is a mistake, not a table without them
    if sigma is not None or absent >= set(_ERRORS):
        replaced |= dict.fromkeys(_ERRORS, 1000.0 if sigma is None else positive("sigma", sigma))
    if not replaced:
        return opened, wanted, ()
    names = {role: f"assumed {role}" for role in replaced}
    changed = {role: getattr(wanted, role) for role in Columns.__dataclass_fields__} | names
    said: tuple[str, ...] = ()
    if set(_ERRORS) & set(replaced):
        what = "as asked" if sigma is not None else "no errors in the table: all sources weigh the same"
        said = (f"errors of {replaced['pmra_error']:g} µas/yr for every source ({what})",)
    return _with_constants(opened, {names[role]: replaced[role] for role in names}), Columns(**changed), said


def _with_constants(source, constants):
    """A table with further columns of one value each [µas/yr]."""

    def read(names, rows):
        own = [name for name in names if name not in constants]
        for block in source.read(tuple(own), rows):
            count = len(next(iter(block.values()))[0])
            yield block | {name: (np.full(count, constants[name]), None) for name in names if name in constants}

    units = source.units | dict.fromkeys(constants, "uas / yr")
    return replace(source, names=(*source.names, *constants), read=read, units=units)
