"""Formats that astropy reads whole: HDF5, the tables of journals (MRT) and of the CDS, and text in columns."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vsh.checks.types import PathName
from vsh.errors import TableError, first_line
from vsh.tables._memory import open_astropy
from vsh.tables._source import TableSource

#: Sexagesimal columns as journals and the CDS name them.
_SEXAGESIMAL = ("RAh", "RAm", "RAs", "DE-", "DEd", "DEm", "DEs")
#: Text that is read whole may have so many bytes; larger tables come as CSV, FITS or Parquet.
_MOST = 2**30
#: A column of HDF5 of more bytes is none. [bytes]
_LARGEST = 2**34


def open_whole(path: PathName, label: str, kind: str) -> TableSource:
    """A table that is read as a whole; masked values stay masked, units and descriptions are kept."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # units that a format spells in its own way
            table = _hdf5(path, label) if kind == "hdf5" else _text(Path(path), label, kind)
    except (TableError, MemoryError):
        raise
    except ImportError as error:
        raise TableError(
            f"{label}: HDF5 needs h5py: pip install 'vsh-astrometry[hdf5]' ({first_line(error)})"
        ) from error
    except Exception as error:  # whatever a damaged file makes of h5py and of the readers of text
        raise TableError(f"{label} cannot be read as {kind.removeprefix('ascii.')}: {first_line(error)}") from error
    if not len(table):
        raise TableError(f"{label} has no rows")
    several = [name for name in table.colnames if table[name].ndim > 1]
    table.remove_columns(several)
    opened = open_astropy(_with_degrees(table))
    notes = (f"columns of several numbers a row are not read: {', '.join(several)}",) if several else ()
    return replace(opened, label=label, notes=notes)


def _hdf5(path, label):
    """The one table of a file: a compound dataset, or a group with a dataset for each column."""
    import h5py
    from astropy.table import Table

    with h5py.File(path, "r") as file:
        compound, groups = [], {}

        def visit(name, item):
            if not isinstance(item, h5py.Dataset):
                return
            if item.nbytes > _LARGEST:
                raise TableError(
                    f"{label}: {name} declares {item.shape} values, {item.nbytes / 2**30:.3g} GiB, in a file of "
                    f"{Path(path).stat().st_size} bytes: HDF5 is read whole; make it FITS or Parquet"
                )
            if item.dtype.names:
                compound.append(name)
            elif item.ndim == 1:
                groups.setdefault(name.rpartition("/")[0], []).append(name)

        file.visititems(visit)
        tables = [name for name in compound if not name.endswith("__table_column_meta__")]
        columned = {group: names for group, names in groups.items() if len(names) > 1 and not tables}
        if len(tables) + len(columned) != 1:
            found = ", ".join([*tables, *columned]) or "none"
            raise TableError(f"{label} holds {len(tables) + len(columned)} tables ({found}): keep one in a file")
        if columned:
            (names,) = columned.values()
            return Table({name.rpartition("/")[2]: _plain(file[name][()]) for name in names})
    return Table.read(path, path=tables[0], format="hdf5", character_as_bytes=False)


def _plain(values: Any) -> Any:
    return np.char.decode(values.astype(bytes), "utf-8", "replace") if values.dtype.kind in "SO" else values


def _text(path, label, kind):
    from astropy.io import ascii

    size = path.stat().st_size
    if size > _MOST:
        raise TableError(
            f"{label} has {size / 2**30:.1f} GiB, too much for text that is read whole: make it CSV, FITS or Parquet"
        )
    with path.open("rb") as file:
        begin = file.read(2**16)
    if b"\0" in begin:
        raise TableError(f"{label} is no text")
    if kind == "ascii":
        return ascii.read(path, format=None, guess=True)
    options = {}
    if b"Byte-by-byte" not in begin:
        readme = path.with_name("ReadMe")
        if not readme.is_file():
            raise TableError(f"{label} does not describe its columns, and there is no file ReadMe beside it that does")
        options = {"readme": str(readme)}
        kind = "ascii.cds"
    return ascii.read(str(path), format=kind.removeprefix("ascii."), guess=False, **options)


def _with_degrees(table):
    """ra and dec in degrees, where the table has hours, minutes and seconds, and no others."""
    if not set(_SEXAGESIMAL) <= set(table.colnames) or {"ra", "dec"} & set(table.colnames):
        return table
    hours, minutes, seconds, sign, degrees, arcmin, arcsec = (table[name] for name in _SEXAGESIMAL)
    negative = np.where(np.ma.getdata(sign).astype(str) == "-", -1.0, 1.0)
    ra = 15 * (np.ma.asarray(hours) + np.ma.asarray(minutes) / 60 + np.ma.asarray(seconds) / 3600)
    dec = negative * (np.ma.asarray(degrees) + np.ma.asarray(arcmin) / 60 + np.ma.asarray(arcsec) / 3600)
    from astropy.table import MaskedColumn

    table.add_columns([MaskedColumn(ra, unit="deg"), MaskedColumn(dec, unit="deg")], names=["ra", "dec"])
    return table
