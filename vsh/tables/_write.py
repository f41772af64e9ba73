"""Tables into files, and whole tables out of them (astropy.table)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.checks.notes import printable
from vsh.checks.types import PathName, Table
from vsh.errors import TableError, first_line
from vsh.system.files import MARK, atomic_write
from vsh.tables._open import format_of, open_table

#: In the metadata of every table that is written: by what.
CREATOR = "CREATOR"


def read(path: PathName) -> Table:
    """Read a whole table; `open_table` reads columns and blocks.

    Parameters
    ----------
    path : str or Path
        FITS, VOTable, ECSV, CSV (with Gaia's null) or Parquet, or a folder of them.

    Raises
    ------
    TableError
        If there is no such file, its format is not known, or it is damaged.
    """
    source = open_table(path)
    if not source.names:
        raise TableError(f"{source.label} has no columns")
    if source.meta.get("__special__"):  # columns of more than one number a row: astropy's own ECSV
        return _read_ecsv(path, source.label)
    return source.to_table()


def as_table(source: Any) -> Table:
    """A path or any table in memory as an astropy Table."""
    from astropy.table import Table

    return source if isinstance(source, Table) else read(source)


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
    """Write an astropy Table, with more metadata, to a new file, which takes the name `path` when it is complete.

    Parameters
    ----------
    table : astropy Table
        Any.
    path : str or Path
        The file.
    meta : dict, optional
        Provenance, plain values.
    """
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


def _read_ecsv(path, label):
    from astropy.table import Table

    _check_memory(path, label)
    try:
        return Table.read(path, format="ascii.ecsv")
    except Exception as error:  # whatever a damaged file makes of a reader
        raise TableError(f"{label} cannot be read as ECSV: {first_line(error)}") from error


def _check_memory(path, label, most=2**28):
    """NumPy gives every row of a column of text the room of the longest."""
    longest = count = 0
    with open(path, "rb") as file:
        for line in file:
            if not line.startswith(b"#"):
                longest, count = max(longest, len(line)), count + 1
    if 4 * longest * count > max(most, 16 * Path(path).stat().st_size):
        raise TableError(f"{label} is damaged, or no result: a line of {longest} characters among {count}")
