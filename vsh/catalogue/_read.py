"""From a table to a Field: columns, units, masks, and counts of what was refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from logging import getLogger
from time import perf_counter
from typing import Any
from warnings import warn

import numpy as np

from vsh.archive import DR4
from vsh.catalogue._chosen import Chosen, nothing_selected
from vsh.catalogue._columns import (
    REQUIRED,
    Columns,
    as_columns,
    doubt_positions,
    frame_of,
    locate,
    redshift_frame_of,
)
from vsh.catalogue._icrf import open_icrf
from vsh.catalogue._units import differing_units, factors, identifiers, plain
from vsh.checks import arguments
from vsh.checks.arguments import whole
from vsh.checks.notes import DroppedRows, dropped, merge_notes, printable
from vsh.checks.types import OnBad, PathName
from vsh.checks.validation import PLACEHOLDER, placeholders
from vsh.errors import NothingLeftError, NothingSelectedError, TableError, VshWarning
from vsh.field import Field
from vsh.parts import OPTIONAL
from vsh.system.logs import tell

_LOG = getLogger(__name__)


def read_field(
    source: Any,
    columns: Columns | Mapping[str, str] | str | None = None,
    units: Mapping[str, Any] | None = None,
    *,
    on_bad: OnBad = "raise",
    frame: str | None = None,
    roles: Iterable[str] = OPTIONAL,
    where: str | None = None,
    format: str | None = None,
) -> Field:
    """Read a field from a table.

    Parameters
    ----------
    source : path, astropy Table or QTable, pandas DataFrame, Arrow stream, dict or structured array
        Files: FITS, VOTable, ECSV, CSV, Parquet, HDF5, tables of journals (MRT), or a folder of them; text and FITS
        also packed with gzip. Only the columns that are needed are read. Objects of pyarrow, polars and DuckDB are
        taken by their `__arrow_c_stream__`, classes made from DataFrame (LSDB's) as DataFrames.
    columns : Columns, "gaia", "vizier", "icrf" or dict, optional
        Where the table keeps what; Gaia's archive names unless given. A dict goes from roles to names, with "names"
        for one of these sets that it changes: {"names": "vizier", "redshift": "zsp"}.
    units : dict, optional
        From column names of the table to units, "uas/yr" say; they override the table's.
        A column without a unit is taken in Gaia's (deg, mas/yr) if it has Gaia's name,
        and a note says so.
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used.
    frame : {"icrs", "galactic", "ecliptic"}, optional
        Of positions and motions; ICRS unless given. Columns called l, b, glon, … in place of ra and
        dec ask for it.
    roles : iterable of str
        Those of name, redshift, magnitude, redshift_error, distance, distance_error that are wanted: what is not read takes no time.
    where : str, optional
        A condition on the table's columns, in its units: "phot_g_mean_mag < 19 and 0.5 < redshift < 2"; see
        `vsh.tables.Where`. Rows with a missing value in it are not selected; a note counts all that are left out.
    format : str, optional
        Of a file whose ending does not tell it: one of `vsh.tables.INPUT_FORMATS`, or "icrf".

    Returns
    -------
    Field
        Its `notes` say what was assumed and what was left out.

    Raises
    ------
    TableError
        If the file cannot be read, a column is missing, or a unit is missing or wrong.
    FieldError
        If a column holds no numbers, or if rows cannot be used.

    Examples
    --------
    >>> field = read_field({"ra": [10.0], "dec": [-20.0], "pmra": [0.1], "pmdec": [0.2],
    ...                     "pmra_error": [0.05], "pmdec_error": [0.05]})
    >>> field.notes[0]
    'no unit in the table, so taken in deg: ra, dec'
    """
    begin = perf_counter()
    make = _maker(open_icrf(source, format), columns, units, on_bad, frame, roles, where)
    field = make(make.source.columns(make.names))
    tell(_LOG, f"read {make.source.label}", field, begin)
    return field


def iter_fields(
    source: Any,
    rows: int = 1_000_000,
    *,
    columns: Columns | Mapping[str, str] | str | None = None,
    units: Mapping[str, Any] | None = None,
    on_bad: OnBad = "raise",
    frame: str | None = None,
    roles: Iterable[str] = OPTIONAL,
    where: str | None = None,
    format: str | None = None,
) -> Iterator[Field]:
    """Read a catalogue larger than memory, a field of at most `rows` sources at a time.

    Parameters
    ----------
    source, columns, units, on_bad, frame, format
        As for `read_field`. Joined, the fields are the one that it reads. (A VOTable is read whole first.)
    rows : int
        The largest number of sources in a field.
    roles : iterable of str
        As there.
    where : str, optional
        As there.

    Returns
    -------
    Field
        ``fit.normal_equations(iter_fields(path), modes)`` fits them all in one pass.

    Raises
    ------
    TableError, FieldError
        As `read_field` does.
    """
    rows = whole("rows", rows)
    make = _maker(open_icrf(source, format), columns, units, on_bad, frame, roles, where)
    return _fields(make, rows)


def _fields(make, rows):
    """Fields block by block; the rows of a block without any usable one are counted by a neighbour."""
    first, held, lost = 0, None, ()
    for block in make.source.blocks(make.names, rows):
        try:
            field = make(block, first)
        except NothingLeftError as error:
            if make.on_bad == "raise" and not isinstance(error, NothingSelectedError):
                raise
            lost, last = merge_notes(lost, error.notes), error
        else:
            if held is not None:
                yield held
            if make.on_bad == "drop" and not any(isinstance(note, DroppedRows) for note in field.notes):
                field = field.add_note(
                    DroppedRows.of_table({}, len(field), field.lon, field.lat)
                )  # totals count all rows
            held, lost = field.add_note(*lost), ()
        first += len(next(iter(block.values()))[0])
    if held is None:
        raise nothing_selected(lost) if make.chosen and not dropped(lost) else last
    yield held.add_note(*lost)


class _maker:
    """What turns columns of one table into fields."""

    def __init__(self, source, columns, units, on_bad, frame, roles=OPTIONAL, where=None):
        self.source = source
        located, self.said = locate(as_columns(columns), self.source)
        self.chosen = None if where is None else Chosen(where, self.source, located)
        self.where = {role: name for role, name in located.items() if role not in OPTIONAL or role in roles}
        self.frame = frame_of(self.where, frame, self.source.meta)
        self.redshift_frame = redshift_frame_of(self.where, self.source)
        self.factors, assumed = factors(self.where, units, self.source)
        # What marks missing values does so in the table's own units; in Gaia's the field looks for it.
        self.other_units = any(self.factors[role] != 1 for role in REQUIRED[2:])
        self.assumed = any("ra" in names for names in assumed.values())
        lines = [f"no unit in the table, so taken in {unit}: {', '.join(names)}" for unit, names in assumed.items()]
        lines += differing_units(self.where, self.factors)
        self.said = [*self.source.notes, *lines, *self.said]
        self.on_bad = on_bad
        self.names = tuple(dict.fromkeys([*self.where.values(), *(self.chosen.names if self.chosen else ())]))

    def __call__(self, block, first_row=0):
        found, raw, said = {}, {}, list(self.said)
        if self.chosen:
            block, first_row, note = self.chosen.of(block, first_row)
            said += note
        for role, name in self.where.items():
            values, mask = block[name]
            if role == "solution":
                found["unusable"] = _other_solutions(name, values, mask)
            elif role == "name":
                found[role], more = identifiers(printable(name), np.asarray(values), mask)
                said += more
            else:
                found[role] = plain(name, values, mask)
                if self.other_units and role in REQUIRED[2:]:
                    raw[role] = np.ma.filled(np.ma.asarray(found[role], float), np.nan)
                if self.factors.get(role, 1.0) != 1.0 or role in REQUIRED:
                    found[role] = found[role] * self.factors[role]
        doubt_positions(found, self.assumed)
        flat = all(values.ndim == 1 for values in raw.values())  # others are refused below
        if raw and flat and (marked := placeholders(raw)).any():
            found["unusable"] = found.get("unusable", {}) | {PLACEHOLDER: marked}
        with np.errstate(invalid="ignore", over="ignore"):
            field = Field.from_columns(
                **found,
                frame=self.frame,
                redshift_frame=self.redshift_frame,
                on_bad=self.on_bad,
                notes=said,
                first_row=first_row,
            )
        for note in said:
            if note.startswith("warning"):
                warn(note, VshWarning, stacklevel=3)
        return field


def _other_solutions(name, values, mask):
    """Rows whose astrometric model is not one for quasars and galaxies, by its number."""
    if values.dtype.kind not in "iuf":
        raise TableError(f"column {printable(name)!r} holds {values.dtype.name}, not numbers of astrometric models")
    missing = np.zeros(len(values), bool) if mask is None else np.asarray(mask)
    other = ~np.isin(values, list(DR4.accepted)) & ~missing
    found = {f"{printable(name)} = {value:g}": values == value for value in np.unique(values[other])}
    return found | ({f"{printable(name)} missing": missing} if missing.any() else {})


def write_field(field: Field, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write a field as a table in Gaia's names and units, which `read_field` reads.

    Parameters
    ----------
    field : Field
        The sources.
    path : str or Path
        Its ending tells the format.
    meta : dict, optional
        Plain values, kept with the table (not by CSV and VOTable)

    Raises
    ------
    ParameterError
        If it is no Field.
    """
    arguments.a(Field)("field", field)
    field.write(path, meta)
