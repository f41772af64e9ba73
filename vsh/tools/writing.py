"""Tables into files: columns, units and provenance, written whole or not at all (astropy.table)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.tools.errors import TableError
from vsh.tools.files import MARK, atomic_write
from vsh.tools.formats import WRITTEN
from vsh.tools.notes import printable
from vsh.tools.types import PathName, Table

#: In the metadata of every table that is written: by what.
CREATOR = "CREATOR"


def format_of(path: PathName, known: Mapping[str, str] = WRITTEN) -> str:
    """astropy's name of the format that the ending of a name tells; TableError where it tells none."""
    path = Path(path)
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes and suffixes[-1] == ".gz":
        suffixes.pop()
    if not suffixes or suffixes[-1] not in known:
        raise TableError(
            f"{printable(path)}: unrecognised format. Known endings: {', '.join(known)}, each also with .gz"
        )
    return known[suffixes[-1]]


def table_of(
    columns: Mapping[str, Any], meta: dict[str, Any] | None = None, units: Mapping[str, str] | None = None
) -> Table:
    """An astropy Table from columns, metadata of plain values and units, all by name."""
    from astropy.table import Table

    table = Table({name: np.asarray(values) for name, values in columns.items()}, meta=meta or {})
    for name, unit in (units or {}).items():
        table[name].unit = unit
    return table


def write(
    path: PathName,
    columns: Mapping[str, Any],
    meta: dict[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write columns as a table to a new file, which takes the name `path` when it is complete."""
    write_table(table_of(columns, meta, units), path)


def write_table(table: Table, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write an astropy Table, with more metadata, to a new file, which takes the name `path` when it is complete."""
    path = Path(path)
    check_writable(path)
    facts = {CREATOR: f"{MARK} {vsh.__version__}"} | {key: each for key, each in table.meta.items() if key != CREATOR}
    table = table.copy(copy_data=False)
    table.meta = type(table.meta)(_plain(facts | (meta or {})))
    kind = format_of(path)
    with atomic_write(path) as new, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # units that a format spells in its own way
        if kind == "votable":
            _write_votable(table, new)
        else:
            table.write(new, format=kind, overwrite=True)


def _plain(value: Any) -> Any:
    """Metadata as YAML knows them: notes that count are text to it."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, str) else value


def _write_votable(table, path):
    """With plain metadata as parameters, which astropy's own writer leaves out."""
    from astropy.io.votable import from_table
    from astropy.io.votable.tree import Param

    document = from_table(table)
    first = document.get_first_table()
    for key, value in table.meta.items():
        if isinstance(value, (bool, int, float, str, np.floating, np.integer)):
            number = not isinstance(value, (str, bool))
            options = {"datatype": "double"} if number else {"datatype": "unicodeChar", "arraysize": "*"}
            first.params.append(Param(document, name=key, value=value if number else str(value), **options))
    document.to_xml(str(path))


def check_writable(path: PathName) -> None:
    """Raise TableError now if a table could not be written to `path` later."""
    path = Path(path)
    kind = format_of(path)
    if not path.absolute().parent.is_dir():
        raise TableError(f"{printable(path)}: there is no such folder")
    if kind == "parquet":
        from importlib.util import find_spec

        if find_spec("pyarrow") is None:
            raise TableError(
                f"{printable(path)} cannot be written. Install what is missing: pip install 'vsh-astrometry[parquet]'"
            )
