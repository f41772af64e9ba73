"""The noun: sources as they are, before anybody observes them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vsh.checks.frozen import Frozen
from vsh.checks.types import FloatArray
from vsh.checks.validation import as_floats
from vsh.errors import FieldError, TableError
from vsh.sky.frames import check_frame


@dataclass(frozen=True, eq=False)
class Population(Frozen):
    """Sources as they are, before anybody observes them.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions [rad]
    magnitude : (n,) array or None
        G.
    redshift : (n,) array or None
    frame : str
        Of the positions.
    """

    lon: FloatArray
    lat: FloatArray
    magnitude: FloatArray | None = None
    redshift: FloatArray | None = None
    frame: str = "icrs"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        for name in ("lon", "lat", "magnitude", "redshift"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.array(as_floats(name, getattr(self, name))[0]))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.lon)

    def __getitem__(self, keep: Any):
        """The sources picked by a mask, a slice or indices."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        return Population(**{k: v[keep] if isinstance(v, np.ndarray) else v for k, v in columns.items()})


def from_table(
    source: Any, *, ra: str = "ra", dec: str = "dec", redshift: str | None = None, magnitude: str | None = None
) -> Population:
    """The positions, and perhaps redshifts and magnitudes, of a real table.

    Parameters
    ----------
    source : path or table
        Whatever `vsh.tables.as_table` takes.
    ra, dec, redshift, magnitude : str
        Names of columns; positions in degrees.

    Returns
    -------
    Population
        In ICRS; a redshift or magnitude that is missing is nan.

    Raises
    ------
    TableError
        If a column is missing.
    FieldError
        If a position is missing or not on the sky, or a column holds no numbers.
    """
    from vsh import tables

    table = tables.as_table(source)
    columns = {}
    for role, name in {"ra": ra, "dec": dec, "redshift": redshift, "magnitude": magnitude}.items():
        if name is None:
            continue
        if name not in table.colnames:
            raise TableError(f"no column {name!r} for {role}. The table has {', '.join(table.colnames)}")
        values, missing = as_floats(name, np.ma.filled(np.ma.asarray(table[name]), np.nan))
        columns[role] = np.where(missing, np.nan, values)
    bad = ~(np.isfinite(columns["ra"]) & (np.abs(columns["dec"]) <= 90))
    if bad.any():
        raise FieldError(
            f"{bad.sum()} of {bad.size} positions are missing or not on the sky (first: row {bad.argmax()})"
        )
    lon, lat = np.radians(columns["ra"]), np.radians(columns["dec"])
    return Population(lon, lat, columns.get("magnitude"), columns.get("redshift"))
