"""Tables into files, and whole tables out of them (astropy.table)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vsh.checks.types import PathName, Table
from vsh.errors import TableError, first_line
from vsh.tables._open import open_table


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
