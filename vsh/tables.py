"""Tables on disk: the one file that knows astropy.table.

Every way a file can be unreadable ends in a TableError that names the file.
"""

import os
import warnings
from pathlib import Path

import numpy as np
from astropy.table import Table

from vsh.errors import TableError
from vsh.files import replacing

#: File name endings and astropy's formats; a further .gz is understood by all but Parquet.
FORMATS = {
    ".fits": "fits",
    ".fit": "fits",
    ".vot": "votable",
    ".votable": "votable",
    ".xml": "votable",
    ".ecsv": "ascii.ecsv",
    ".csv": "ascii.csv",
    ".parquet": "parquet",
    ".pq": "parquet",
}
#: What stands for a missing value in text tables; Gaia's archive writes null.
NULLS = [("", "0"), ("null", "0"), ("NULL", "0")]


def read(path):
    """Read a table, its format told by the ending of its name.

    Parameters
    ----------
    path : str or Path — FITS, VOTable, ECSV, CSV (with Gaia's null) or Parquet

    Returns
    -------
    astropy.table.Table

    Raises
    ------
    TableError
        If there is no such file, its format is not known, or it is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise TableError(f"{path}: {'is a folder, not a table' if path.is_dir() else 'no such file'}")
    kind = format_of(path)
    options = {"fill_values": NULLS} if kind.startswith("ascii") else {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            table = Table.read(path, format=kind, **options)
        except Exception as error:  # whatever a damaged file makes of a reader
            raise TableError(f"{path} cannot be read as {kind}: {_first_line(error)}{_remedy(error)}") from error
    for warning in caught:
        if "truncated" in str(warning.message):
            raise TableError(f"{path} is damaged: {_first_line(warning.message)}. Fetch it again")
    if not table.colnames:
        raise TableError(f"{path} has no columns")
    return table


def as_table(source):
    """A path, an astropy table, a pandas DataFrame, a dict or a structured array as an astropy Table."""
    if isinstance(source, (str, os.PathLike)):
        return read(source)
    if isinstance(source, Table):
        return source
    if type(source).__module__.split(".")[0] == "pandas":
        return Table.from_pandas(source)
    try:
        return Table(source)
    except Exception as error:
        raise TableError(f"a {type(source).__name__} is no table: {_first_line(error)}") from error


def table_of(columns, meta=None, units=None):
    """An astropy Table from columns, metadata of plain values and units, all by name."""
    table = Table({name: np.asarray(values) for name, values in columns.items()}, meta=meta or {})
    for name, unit in (units or {}).items():
        table[name].unit = unit
    return table


def write(path, columns, meta=None, units=None):
    """Write columns as a table to a new file, which takes the name `path` when it is complete.

    Parameters
    ----------
    path : str or Path — its ending tells the format, as in `read`
    columns : dict of name to (n,) array
    meta : dict, optional — plain values, kept with the table
    units : dict of name to str, optional
    """
    write_table(table_of(columns, meta, units), path)


def write_table(table, path, meta=None):
    """Write an astropy Table, with more metadata, to a new file, which takes the name `path` when it is complete."""
    path = Path(path)
    table.meta.update(meta or {})
    with replacing(path) as new:
        table.write(new, format=format_of(path), overwrite=True)


def format_of(path):
    """astropy's name of the format that the ending of a name tells; TableError where it tells none."""
    path = Path(path)
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes and suffixes[-1] == ".gz":
        suffixes.pop()
    if not suffixes or suffixes[-1] not in FORMATS:
        raise TableError(f"{path}: what format is this? Known endings: {', '.join(FORMATS)}, each also with .gz")
    return FORMATS[suffixes[-1]]


def _first_line(error):
    text = str(error).strip()
    return text.splitlines()[0].rstrip(".") if text else type(error).__name__


def _remedy(error):
    if isinstance(error, ImportError):
        return ". Install what is missing: pip install 'vsh-astrometry[parquet]'"
    return ""
