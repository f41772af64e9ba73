"""From a table to a Field: columns, units, masks, and counts of what was refused; and all else a fit may be given."""

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from logging import getLogger
from pathlib import Path
from time import perf_counter
from typing import Any
from warnings import warn

import numpy as np

from vsh.field import Field, SourcesWithErrors
from vsh.io import tables
from vsh.io.archive import DR4
from vsh.io.catalogue._columns import (
    MODULUS,
    RowSelection,
    as_columns,
    as_doubles,
    check_position_unit,
    convert_identifiers,
    convert_moduli_to_distances,
    describe_mixed_units,
    describe_odd_values,
    find_conversion_factors,
    locate_columns,
    make_empty_selection_error,
    parse_sexagesimal,
)
from vsh.io.catalogue._frames import find_frames, find_redshift_frame, read_redshift_frame, turn_positions
from vsh.io.catalogue._names import USUAL_UNITS, Columns, add_derived_columns, derive_columns
from vsh.io.columns import ASSUMED, REQUIRED, missing_column, parse_unit
from vsh.io.maps import read_density
from vsh.io.parts import OPTIONAL, Parts
from vsh.scalars import ScalarField
from vsh.sky.frames import AXES, REDSHIFT_FRAME_COLUMN
from vsh.tools.arguments import positive, whole
from vsh.tools.bad_rows import PLACEHOLDER, find_placeholder_rows, find_zero_motion_rows
from vsh.tools.errors import EmptyFieldError, EmptySelectionError, FieldError, TableError, VshWarning
from vsh.tools.notes import (
    ASSUMED_MOTIONS,
    ASSUMED_UNITS,
    DOUBT,
    NO_REDSHIFTS,
    UNUSED_CORRELATIONS,
    CodedNote,
    DroppedRows,
    count_dropped,
    has_code,
    merge_notes,
)
from vsh.tools.printing import log_result, printable
from vsh.tools.types import FloatArray, OnBad
from vsh.vector import Vector

_LOG = getLogger(__name__)
#: Columns that tables of epoch astrometry have, a row a transit or a source, in either of DPAC's spellings.
_EPOCHS = {"obstimetcb", "centroidposal"}
#: Parallaxes of quasars and their errors are smaller than this in the median, in any unit but a wrong one, and errors
#: of no survey are below the other. [µas]
_LARGE_PARALLAX, _SMALL_ERROR = 1e4, 1.0
#: The place of a row in its table, beside its columns.
_ROW = "row of the table"


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
    sigma: float | None = None,
) -> Field:
    """Read a field from a table.

    Parameters
    ----------
    source : path, astropy Table or QTable, pandas DataFrame, Arrow stream, dict or structured array
        Files: FITS, VOTable, ECSV, CSV, Parquet, HDF5, tables of journals (MRT), or a folder of them; text and FITS
        also packed with gzip. Only the columns that are needed are read. Objects of pyarrow, polars and DuckDB are
        taken by their `__arrow_c_stream__`, classes made from DataFrame (LSDB's) as DataFrames. Epoch astrometry is
        solved for motions by `vsh.io.epochs.read_epochs`.
    columns : Columns, "gaia", "vizier", "icrf" or dict, optional
        Where the table keeps what; Gaia's archive names unless given. A dict goes from roles to names, with "names"
        for one of these sets that it changes: {"names": "vizier", "redshift": "zsp"}.
    units : dict, optional
        From column names of the table to units, "uas/yr" say; they override the table's. A column without a unit is
        taken in Gaia's (deg, mas/yr) if it has Gaia's name, and a note says so.
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used.
    frame : {"icrs", "galactic", "ecliptic"}, optional
        Axes of positions and motions. Default: those that the table states, or ICRS. It must be given for positions in
        columns such as l, b or glon if the names of the motions do not say the same.
    roles : iterable of str
        Optional quantities to read if the table has them, such as "name", "redshift" and "magnitude".
    where : str, optional
        A condition on the table's columns, in its units: "phot_g_mean_mag < 19 and 0.5 < redshift < 2"; see
        `vsh.io.tables.Where`. Rows with a missing value in it are not selected; a note counts all that are left out.
        A table of epochs takes "field of view 1" or 2, or "CCD row 1" to 7, alone.
    format : str, optional
        Where the ending does not tell it: fits, votable, ecsv, mrt, csv, parquet, hdf5, cds, ascii or icrf.
    sigma : float, optional
        One error for all motions in place of those of the table, which may have none. [µas/yr]

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
    table = tables.open_table(source, format)
    if has_epochs(table.names):
        field = _solve_epochs(table, columns, on_bad, where, {"units": units, "frame": frame, "sigma": sigma})
    else:
        maker = _FieldMaker(table, columns, units, on_bad, frame, roles, where, sigma)
        field = maker(maker.source.columns(maker.names))
    return log_result(_LOG, f"read {table.label}", field, begin)


def has_epochs(names: Iterable[str]) -> bool:
    """Tell whether a table has epoch astrometry in place of motions, by its names."""
    return {name.replace("_", "").lower() for name in names} >= _EPOCHS


def _solve_epochs(table, columns, on_bad, where, other_options):
    """The field that epoch astrometry gives, where a table has epochs in place of motions."""
    from vsh.io.epochs import read_epochs

    refused_options = [name for name, value in other_options.items() if value is not None]
    if refused_options or not (columns is None or isinstance(columns, Mapping)):
        refused = ", ".join(refused_options) or "names of columns other than single ones"
        raise TableError(f"{table.label} holds epoch astrometry, whose units and axes are Gaia's: leave out {refused}")
    if not {"ra0", "dec0"} <= {*table.names, *(columns or ())}:
        raise TableError(
            f"{table.label} holds epoch astrometry without positions. Solve it for motions first, with a table of "
            "source_id, ra and dec: vsh.io.epochs.read_epochs(epochs, positions=…).write('motions.fits')"
        )
    remark = f"{table.label}: epoch astrometry, solved for the motion of each source (vsh.io.epochs.read_epochs)"
    return read_epochs(table, on_bad=on_bad, columns=columns, where=where).add_note(remark)


def read_columns(source: Any, names: Iterable[str], **reading: Any) -> dict[str, FloatArray]:
    """Numbers of any columns, at the rows that `read_field` reads.

    Parameters
    ----------
    source : path, table or TableSource
        As for `read_field`.
    names : iterable of str
        Names of the columns.
    **reading
        The arguments of `read_field` that chose the rows: columns, units, on_bad, frame, where, format.

    Returns
    -------
    dict of (n,) arrays
        In the units of the table; missing values are nan.

    Raises
    ------
    TableError
        If there is no such column.
    FieldError
        If one holds no numbers, or `read_field` would raise it.
    """
    names = list(names)
    maker = _make_maker_with_columns(source, names, reading)
    _, values = _read_field_and_columns(maker, maker.source.columns(maker.names), names, 0)
    return values


def stream_columns(
    source: Any, names: Iterable[str], rows: int = 1_000_000, **reading: Any
) -> Iterator[tuple[Field, dict[str, FloatArray]]]:
    """A catalogue larger than memory: fields of at most `rows` sources, and numbers of any columns beside them."""
    names, first_row = list(names), 0
    maker = _make_maker_with_columns(source, names, reading)
    for block in maker.source.blocks(maker.names, whole("rows", rows)):
        try:
            yield _read_field_and_columns(maker, block, names, first_row)
        except EmptyFieldError as error:
            if maker.on_bad == "raise" and not isinstance(error, EmptySelectionError):
                raise
        first_row += len(next(iter(block.values()))[0])


def _make_maker_with_columns(source, names, reading):
    """Maker of fields of a table with further columns."""
    options = {"columns": None, "units": None, "on_bad": "raise", "frame": None, "where": None, "sigma": None} | reading
    table = tables.open_table(source, options.pop("format", None))
    for name in names:
        if name not in table.names:
            raise TableError(f"{table.label}: {missing_column(name, table)}")
    table, options["columns"], _ = add_zero_motions(table, options["columns"])  # columns need no motions beside them
    maker = _FieldMaker(table, **options, roles=())
    maker.names = tuple(dict.fromkeys((*maker.names, *names)))
    maker.column_of["name"] = _ROW  # names are carried along by whatever leaves rows out
    return maker


def _read_field_and_columns(maker, block, names, first_row):
    """The field of a block, and numbers of columns at its rows."""
    block = dict(block)
    values = {name: np.ma.filled(as_doubles(name, *block[name]), np.nan) for name in names}
    block[_ROW] = np.arange(len(next(iter(block.values()))[0])), None
    field = maker(block, first_row)
    indices = np.asarray(field.name, int)
    return field, {name: array[indices] for name, array in values.items()}


def stream_fields(
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
    sigma: float | None = None,
) -> Iterator[Field]:
    """A catalogue larger than memory, as fields of at most `rows` sources; options as for `read_field`."""
    rows = whole("rows", rows)
    maker = _FieldMaker(tables.open_table(source, format), columns, units, on_bad, frame, roles, where, sigma)
    return _yield_fields(maker, rows)


def _yield_fields(maker, max_rows):
    """Fields block by block; the rows of a block without any usable one are counted by a neighbour."""
    first_row, pending_field = 0, None
    notes: tuple[str, ...] = ()
    for block in maker.source.blocks(maker.names, max_rows):
        try:
            field = maker(block, first_row)
        except EmptyFieldError as error:
            if maker.on_bad == "raise" and not isinstance(error, EmptySelectionError):
                raise
            notes, last_error = merge_notes(notes, error.notes), error
        else:
            if pending_field is not None:
                yield pending_field
            if maker.on_bad == "drop" and not any(isinstance(note, DroppedRows) for note in field.notes):
                # Totals count all rows.
                field = field.add_note(DroppedRows.of_table({}, len(field), field.lon, field.lat))
            pending_field, notes = field.add_note(*notes), ()
        first_row += len(next(iter(block.values()))[0])
    if pending_field is None:
        raise make_empty_selection_error(notes) if maker.selection and not count_dropped(notes) else last_error
    yield pending_field.add_note(*notes)


class _FieldMaker:
    """Maker of fields from the columns of one table."""

    def __init__(self, source, columns, units, on_bad, frame, roles=OPTIONAL, where=None, sigma=None):
        self.source = add_derived_columns(source)
        assumed_errors: list[str] = []
        if sigma is not None:  # one error for all motions
            size = positive("sigma", sigma)
            names = {role: f"{ASSUMED}{role}" for role in _ERRORS}
            columns = replace(as_columns(columns).choose_names(self.source.names)[0], **names, pmra_pmdec_corr=None)
            self.source = derive_columns(self.source, {name: ((), lambda: size, "uas / yr") for name in names.values()})
            assumed_errors = [CodedNote(f"errors of {size:g} µas/yr for every source (as asked)", ASSUMED_MOTIONS)]
        column_of_role, notes = locate_columns(as_columns(columns), self.source)
        self.selection = None if where is None else RowSelection(where, self.source, column_of_role, units)
        self.column_of = {role: name for role, name in column_of_role.items() if role not in OPTIONAL or role in roles}
        self.frames = find_frames(self.column_of, frame, self.source)
        self.frame = self.frames.frame
        self.redshift_frame = find_redshift_frame(self.column_of, self.source)
        if "redshift" in self.column_of and self.redshift_frame is None and REDSHIFT_FRAME_COLUMN in self.source.names:
            self.column_of[REDSHIFT_FRAME_COLUMN] = REDSHIFT_FRAME_COLUMN
        _, set_name = as_columns(columns).choose_names(self.source.names)
        self.factors, assumed_units = find_conversion_factors(
            self.column_of, units, self.source, USUAL_UNITS.get(set_name or "")
        )
        if (self.factors.get("distance") == MODULUS) != (self.factors.get("distance_error") == MODULUS):
            raise TableError("a distance modulus and its error are both in mag: say so of both columns (--units)")
        # What marks missing values does so in the table's own units; in Gaia's the field looks for it.
        self.units = self.source.units | {self.column_of.get(name, name): unit for name, unit in (units or {}).items()}
        self.has_other_units = any(self.factors[role] != 1 for role in REQUIRED[2:])
        is_unit_given = {"ra", self.column_of["ra"]} & {*(units or ())}
        is_unit_assumed = any(self.column_of["ra"] in names for names in assumed_units.values())
        self.is_position_unit_assumed = None if is_unit_given else is_unit_assumed
        #: What stands in place of a motion, where it is a number.
        motion_column = self.column_of["pmra"]
        is_number = motion_column.startswith(f"{ASSUMED}pm") and motion_column == self.column_of["pmdec"]
        self.scalar_name = motion_column.removeprefix(f"{ASSUMED}pm") if is_number else None
        column_units = (self.source.units.get(name) for name in self.column_of.values() if not name.startswith(ASSUMED))
        has_no_units = self.scalar_name is None and not any(column_units)
        # What is assumed of motions decides on the result; of positions alone, where other columns have units, less.
        decisive_columns = {self.column_of[role] for role in (self.column_of if has_no_units else REQUIRED[2:])}
        column_notes: list[str] = []
        for unit, names in assumed_units.items():
            code = "" if decisive_columns.isdisjoint(names) else ASSUMED_UNITS
            column_notes.append(CodedNote(f"no unit in the table, so taken in {unit}: {', '.join(names)}", code))
        self.is_motion_unit_assumed = any(
            not {*names}.isdisjoint(map(self.column_of.get, _MOTIONS)) for names in assumed_units.values()
        )
        column_notes += describe_mixed_units(self.column_of, self.factors)
        if (error_column := self.column_of.get("redshift_error", "redshift_error")) != "redshift_error":
            column_notes.append(f"errors of the redshifts are in column {printable(error_column)}")
        column_notes += _describe_unread_redshifts(column_of_role, self.source) if "redshift" in roles else []
        self.notes = [*self.source.notes, *column_notes, *assumed_errors, *notes, *self.frames.notes]
        self.on_bad = on_bad
        self.names = tuple(dict.fromkeys([*self.column_of.values(), *(self.selection.names if self.selection else ())]))

    def __call__(self, block, first_row=0):
        columns, raw_columns, notes, redshift_frame = {}, {}, list(self.notes), self.redshift_frame
        aside: dict[str, Any] = {}
        if self.selection:
            block, first_row, row_notes = self.selection.select_rows(block, first_row)
            notes += row_notes
        for role, name in self.column_of.items():
            values, mask = block[name]
            if role == "solution":
                aside |= _find_other_solutions(name, values, mask)
            elif role == "quality":
                aside |= _find_flagged_rows(name, values, mask)
            elif role == REDSHIFT_FRAME_COLUMN:
                redshift_frame = read_redshift_frame(values, self.source)
            elif role == "name":
                columns[role], name_notes = convert_identifiers(printable(name), np.asarray(values), mask)
                notes += name_notes
            else:
                degrees = parse_sexagesimal(role, name, values, mask, str(self.units.get(name) or ""))
                columns[role] = as_doubles(name, values if degrees is None else degrees, mask, first_row)
                if role in _ERRORS and columns[role].size:
                    _check_any_error_positive(name, columns[role])
                if self.has_other_units and role in REQUIRED[2:]:
                    raw_columns[role] = np.ma.filled(np.ma.asarray(columns[role], float), np.nan)
                if degrees is None and self.factors.get(role, 1.0) not in (1.0, MODULUS):
                    columns[role] = columns[role] * self.factors[role]
                if role == "pmra_pmdec_corr":
                    _check_most_correlations(name, columns[role])
        if self.factors.get("distance") == MODULUS:
            notes += convert_moduli_to_distances(columns)
        if self.scalar_name is not None and not (finite := np.isfinite(columns["pmra"])).all():
            columns["unusable"] = {f"{self.scalar_name} not finite": ~np.ma.filled(finite, True)}
        if not any(self.column_of[role].startswith(ASSUMED) for role in _MOTIONS):
            aside |= find_zero_motion_rows(*(columns[role] for role in _MOTIONS))
        notes += check_position_unit(columns, self.is_position_unit_assumed, names=self.column_of)
        if self.frames.positions != self.frame:
            turn_positions(columns, self.frames)
        is_flat = all(values.ndim == 1 for values in raw_columns.values())  # others are refused below
        if raw_columns and is_flat and (is_placeholder := find_placeholder_rows(raw_columns)).any():
            columns["unusable"] = columns.get("unusable", {}) | {PLACEHOLDER: is_placeholder}
        with np.errstate(invalid="ignore", over="ignore"):
            field = Field.from_columns(
                **columns,
                aside=_collect_drop_reasons(self.column_of, block, aside, self.scalar_name or "proper motion"),
                frame=self.frame,
                redshift_frame=redshift_frame,
                on_bad=self.on_bad,
                notes=notes,
                first_row=first_row,
            )
        doubts = [] if self.scalar_name else describe_odd_values(field, is_unit_assumed=self.is_motion_unit_assumed)
        for warning in (*notes, *doubts, *(note for note in field.notes if has_code(note, NO_REDSHIFTS))):
            if has_code(warning, DOUBT, NO_REDSHIFTS, UNUSED_CORRELATIONS):
                warn(warning, VshWarning, stacklevel=3)
        return field.add_note(*doubts) if doubts else field


def _check_most_correlations(name, values):
    """Raise FieldError where most correlations of a column are none."""
    with np.errstate(invalid="ignore"):
        n_beyond = int(np.ma.filled(np.abs(values) > 1, False).sum())
    if 2 * n_beyond > len(values):
        option = shlex.quote(f"{name}=percent")
        text = f"{n_beyond} of {len(values)} correlations in column {name!r} are beyond ±1: are they in per cent?"
        raise FieldError(f"{text} Say so, units={{{name!r}: 'percent'}} (--units {option})")


def _check_any_error_positive(name, errors):
    """Raise FieldError where no error of a column is above zero."""
    with np.errstate(invalid="ignore"):
        if errors.dtype.kind in "iuf" and np.all(np.ma.filled(errors <= 0, False)):
            column = printable(name.removeprefix(f"{ASSUMED}pm"))  # of positions, where these stand for motions
            raise FieldError(
                f"column {column!r} is zero or negative in all rows, so there are no errors: sigma=100 (--columns "
                "sigma=100) gives all sources the same error in µas/yr"
            )


def _collect_drop_reasons(column_of, block, aside, motion_label):
    """Reasons to leave rows out that are no mistake: other models, and positions or motions that are marked missing.

    What is missing in a source is missing as a whole: a row with one component of a motion is a mistake.
    """
    for quantity, roles in (("position", REQUIRED[:2]), (motion_label, REQUIRED[2:4])):
        masks = [_find_missing_rows(*block[column_of[role]]) for role in roles if role in column_of]
        if len(masks) < 2 or any(mask.ndim != 1 for mask in masks):
            continue
        missing = np.logical_and.reduce(masks)
        for mask in aside.values():
            missing &= ~mask
        if missing.any():
            aside = aside | {f"{quantity} missing": missing}
    return aside


def _find_missing_rows(values, mask):
    """Rows without a value: FITS has nan alone to say so of numbers with a point."""
    is_nan = np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, bool)
    return is_nan if mask is None else is_nan | np.asarray(mask)


def _find_other_solutions(name, values, mask):
    """Rows whose astrometric model is not one for quasars and galaxies, by its number."""
    values, is_known = _read_flag_numbers(name, values, mask, "solution")
    is_other = ~np.isin(values, list(DR4.accepted)) & is_known  # where it is null, the motions say what they are
    return {
        f"{printable(name)} = {value:g} ({'position alone' if value == 3 else 'not of 5 or 6 parameters'})": (
            is_other & (values == value)
        )
        for value in np.unique(values[is_other])
    }


def _find_flagged_rows(name, values, mask):
    """Rows whose flag of quality is not zero, or missing: nobody has said that these are good."""
    values, is_known = _read_flag_numbers(name, values, mask, "quality")
    masks = {"not 0": is_known & (values != 0), "missing": ~is_known}
    remedy = "(columns={'quality': None}, --columns quality=, uses these)"
    return {f"{printable(name)} is {fault} {remedy}": flagged for fault, flagged in masks.items() if flagged.any()}


#: How tables write flags as text.
_FLAG_WORDS = {"true": 1.0, "t": 1.0, "yes": 1.0, "false": 0.0, "f": 0.0, "no": 0.0} | dict.fromkeys(
    ("", "none", "null", "<na>"), np.nan
)


def _read_flag_numbers(name, values, mask, role):
    """The numbers of a model or flag, which joined tables hold as floats or as text, and where they are known."""
    if values.dtype.kind in "OSU":
        present = values if mask is None else np.where(mask, "", values)
        texts = [entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry) for entry in present]
        words, word_indices = np.unique([text.strip().lower() for text in texts], return_inverse=True)
        numbers = []
        try:
            for word in words:
                numbers.append(_FLAG_WORDS[word] if word in _FLAG_WORDS else float(word))
        except ValueError:
            remedy = f"columns={{{role!r}: None}} (--columns {role}=)"
            raise TableError(
                f"column {printable(name)!r} holds text, such as {printable(words[len(numbers)])!r}, where numbers say "
                f"which rows can be used: {remedy} uses all rows"
            ) from None
        values = np.array(numbers)[word_indices] if len(word_indices) else np.zeros(0)
    elif values.dtype.kind not in ("iuf" if role == "solution" else "iufb"):
        raise TableError(f"column {printable(name)!r} holds {values.dtype.name}, not numbers")
    is_known = np.ones(len(values), bool) if mask is None else ~np.asarray(mask)
    return values, is_known & (values == values)


def _describe_unread_redshifts(column_of, source):
    """A note on columns of redshifts or distances that are not read: of redshifts where a table has no other."""
    if "redshift" in column_of:
        is_unread = "distance" not in column_of and "distance" in source.names
        return ["column distance is not used: --columns distance=distance,distance_error=NAME takes it"] * is_unread
    candidates = [name for name in source.names if "redshift" in name.lower() and not _ERROR_NAME.search(name)]
    if not candidates:
        return []
    listing = ", ".join(map(printable, candidates[:3]))
    return [f"no redshift is read; the table has {listing}: --columns redshift={printable(candidates[0])} takes it"]


#: Words by which a name is that of an error, a flag or a limit.
_ERROR_NAME = re.compile(r"err|sig|unc|flag|warn|_[elu]$|^e_|low|upp|_l\d|_u\d", re.IGNORECASE)


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
    """Read positions and errors; what the table lacks of motions is zero. A HEALPix map is a density of sources."""
    table = tables.open_table(source, format)
    if isinstance(source, (str, Path)) and is_map(table):
        if columns is not None or where is not None:
            raise TableError(f"{table.label} is a HEALPix map, which has neither columns nor rows to select")
        return read_density(source, 1000.0 if sigma is None else sigma, frame)
    table, position_columns, notes = add_zero_motions(table, columns, sigma)
    return read_field(table, position_columns, units, on_bad=on_bad, frame=frame, where=where).add_note(*notes)


def is_map(table: tables.TableSource) -> bool:
    """Tell whether an open table is a HEALPix map rather than a catalogue."""
    return str(table.meta.get("PIXTYPE", "")).upper() == "HEALPIX" and not {"ra", "lon"} & set(table.names)


def add_zero_motions(
    table: tables.TableSource, columns: Any, sigma: float | None = None
) -> tuple[tables.TableSource, Columns, tuple[str, ...]]:
    """Add zero motions and errors to a table that lacks them; return the table, its columns, and notes.

    If there are no motions, errors of positions are used as errors of motions, to weight the sources.
    """
    table = add_derived_columns(table)
    resolved_columns, _ = as_columns(columns).choose_names(table.names)
    absent = {role for role in (*_MOTIONS, *_ERRORS) if getattr(resolved_columns, role) not in table.names}
    recipes: dict[str, Any] = {}
    notes: tuple[str, ...] = ()
    is_one_missing = len(absent & set(_MOTIONS)) == 1  # a mistake, not a table without them
    if not is_one_missing and (absent >= set(_MOTIONS) or sigma is not None):  # rows are kept whose motion is missing
        recipes |= {role: ((), lambda: 0.0, "uas / yr") for role in _MOTIONS}
    position_errors = {f"pm{name}": name for name in ("ra_error", "dec_error")}
    if sigma is None and absent == {*_MOTIONS, *_ERRORS} and set(position_errors.values()) <= set(table.names):
        for role, name in position_errors.items():
            unit = str(table.units.get(name) or "mas")
            recipes[role] = (name,), lambda values: values, f"{unit} / yr"
        if "ra_dec_corr" in table.names:
            recipes["pmra_pmdec_corr"] = ("ra_dec_corr",), lambda values: values, None
        notes = ("errors of positions weigh the sources: ra_error, dec_error as errors of motions per year",)
    elif sigma is not None or absent >= set(_ERRORS):
        error_size = 1000.0 if sigma is None else positive("sigma", sigma)
        recipes |= {role: ((), lambda: error_size, "uas / yr") for role in _ERRORS}
        reason = "as asked" if sigma is not None else "no errors in the table: all sources weigh the same"
        notes = (CodedNote(f"errors of {error_size:g} µas/yr for every source ({reason})", ASSUMED_MOTIONS),)
    if not recipes:
        return table, resolved_columns, ()
    names = {role: f"{ASSUMED}{role}" for role in recipes}
    table = derive_columns(table, {names[role]: recipe for role, recipe in recipes.items()})
    return table, replace(resolved_columns, **names), notes


def truth_of(source: Any) -> dict[str, Any] | None:
    """Truth of a simulated table by its metadata, or None: spin, acceleration and further parameters.

    Galaxies have our velocity and H0, the stars of a link an orientation and a jump of the spin.
    """
    meta = {str(key).upper(): value for key, value in tables.open_table(source).meta.items()}

    def read_vector(key, unit="µas/yr"):
        return Vector(np.array([float(meta[f"{key}_{axis}"]) for axis in "XYZ"]), np.zeros((3, 3)), unit=unit)

    try:
        truth = {"spin": read_vector("SPIN"), "acceleration": read_vector("ACC")}
    except (KeyError, TypeError, ValueError):
        return None
    with suppress(KeyError, TypeError, ValueError):
        truth |= {"orientation": read_vector("ORIENT", "µas"), "jump": read_vector("JUMP")}
    with suppress(KeyError, TypeError, ValueError):
        truth |= {"velocity": read_vector("VEL", "km/s"), "hubble": float(meta["HUBBLE"])}
        truth["group"] = read_vector("GROUP", "km/s")
    return truth


def read_scalars(
    source: Any,
    value: str = "parallax",
    error: str | None = None,
    *,
    columns: Columns | Mapping[str, str] | str | None = None,
    units: Mapping[str, Any] | None = None,
    unit: str | None = None,
    on_bad: OnBad = "raise",
    frame: str | None = None,
    where: str | None = None,
    format: str | None = None,
) -> ScalarField:
    """Read a scalar field from a table: parallaxes of quasars, unless another column is asked for.

    Parameters
    ----------
    source : path, table, dict
        As for `vsh.io.catalogue.read_field`.
    value : str
        Column of the numbers, or what is to be calculated of columns: "parallax - zero_point".
    error : str, optional
        Column of their standard errors: that of the first column of `value` unless given, "parallax_error" of
        "parallax".
    columns, units, on_bad, frame, where, format
        As for `read_field`: the names of positions and names, the rows to use, the axes of the positions.
    unit : str, optional
        Unit to convert to. Default: that of the first column, and µas for mas, which Gaia's parallaxes have where no
        unit is stated. Columns without a unit, and constants of a formula, are in the unit of the first column.

    Raises
    ------
    TableError
        If a column is missing, or its unit is another kind.
    FieldError
        If a column holds no numbers, or rows cannot be used.

    Examples
    --------
    >>> table = {"ra": [10.0], "dec": [-20.0], "parallax": [-0.02], "parallax_error": [0.1], "bias": [-0.03]}
    >>> read_scalars(table).values
    array([-20.])
    >>> read_scalars(table, "parallax - bias").values.round(6)
    array([10.])
    >>> read_scalars(table, "parallax + 0.017").values.round(6)
    array([-3.])
    """
    table = add_derived_columns(tables.open_table(source, format))
    formula = tables.Where(f"column({value!r})" if value in table.names else value)
    if not formula.names:
        raise TableError(f"{value!r} names no column")
    main = formula.names[0]  # a join adds a suffix to either: parallax_1, parallax_error_1
    joined_error = re.sub(r"(_[^_]+)$", r"_error\1", main)
    error = error or (joined_error if joined_error != main and joined_error in table.names else f"{main}_error")
    for name in (*formula.names, error):
        if name not in table.names:
            remedy = f"; another has the errors? Say error= (--value {printable(value)},NAME)" if name == error else ""
            raise TableError(missing_column(name, table) + remedy)
    used = tuple(dict.fromkeys((*formula.names, error)))
    unit_of, notes = {name: str((units or {}).get(name) or table.units.get(name) or "") for name in used}, []
    base = unit_of[used[0]] or ("mas" if used[0] == "parallax" else "")  # in which constants of the formula are, too
    if base and (unitless := [name for name in used if not unit_of[name]]):
        notes = [f"no unit in the table, so taken in {base}: {', '.join(map(printable, unitless))}"]
    target = parse_unit(unit or ("uas" if parse_unit(base) == parse_unit("mas") else base))
    try:
        factors = {name: parse_unit(unit_of[name] or base).to(parse_unit(base)) for name in used}
        scale = parse_unit(base).to(target)
    except ValueError as wrong:  # astropy's UnitConversionError is one
        raise TableError(f"the units of {', '.join(map(printable, used))} do not go together: {wrong}") from None

    def convert_numbers(name, column):
        """A column in the unit of the first, without what marks a missing value in its own."""
        is_mark = find_placeholder_rows({"pmra": column, "pmdec": column}) & (factors[name] * scale != 1)
        if name == main and target == parse_unit("uas"):  # other numbers may be zero
            is_mark = np.logical_or.reduce([is_mark, *find_zero_motion_rows(column, column).values()])
        return np.where(is_mark, np.nan, column) * factors[name]

    def compute_values(*columns):
        values = {name: convert_numbers(name, column) for name, column in zip(formula.names, columns, strict=True)}
        multiples = ({name: (k * n, None) for name, n in values.items()} for k in (1, 2, 3))
        once, twice, thrice = map(formula.calculate, multiples)
        step = np.nan_to_num(twice - once)
        if base and np.nan_to_num(once).any() and not (step.any() and np.allclose(np.nan_to_num(thrice - twice), step)):
            raise TableError(f"{printable(value)} is not in {base}, as {printable(main)} is: add and subtract columns")
        return scale * once

    # The numbers stand for both components of a motion: what is checked of a catalogue's rows is checked of these.
    names = {"value": f"{ASSUMED}pm{value}", "error": f"{ASSUMED}pm{error}"}
    recipes = {
        names["value"]: (formula.names, compute_values, "uas / yr"),
        names["error"]: ((error,), lambda column: scale * convert_numbers(error, column), "uas / yr"),
    }
    roles = {role: names["error" if role in _ERRORS else "value"] for role in (*_MOTIONS, *_ERRORS)}
    choice = replace(as_columns(columns).choose_names(table.names)[0], **roles, pmra_pmdec_corr=None)
    if frame is None:  # a field that was written has the names of its own axes
        frame = next((key for key, axis in AXES.items() if (choice.ra, choice.dec) == axis[:2] != ("ra", "dec")), None)
    field = read_field(
        derive_columns(table, recipes), choice, units, on_bad=on_bad, frame=frame, where=where, roles=("name",)
    )
    unit = "µas" if target == parse_unit("uas") else target.to_string()
    numbers = field.motion[0], field.sigma[0]
    is_parallax = unit == "µas" or ("parallax" in main.lower() and target.is_equivalent(parse_unit("uas")))
    if is_parallax and len(field):
        value_size, error_size = (target.to(parse_unit("uas")) * float(np.median(np.abs(part))) for part in numbers)
        largest = max(value_size, error_size)
        doubt = f"values, or of their errors, are above {largest:.3g}" if largest > _LARGE_PARALLAX else ""
        if doubt := doubt or (f"errors are below {error_size:.3g}" if error_size < _SMALL_ERROR else ""):
            text = f"warning: half of the {doubt} µas: is the unit right in which {', '.join(map(printable, used))}"
            notes.append(CodedNote(f"{text} were taken (--units)?", DOUBT))
    return ScalarField(field.lon, field.lat, *numbers, unit, field.name, field.frame, (*notes, *field.notes))


def is_readable(value: Any) -> bool:
    """Return whether a field can be read from it: a path, or a table with columns by their names."""
    return isinstance(value, str | Path) or any(
        hasattr(value, attribute) for attribute in ("colnames", "columns", "column_names")
    )


def as_field(name: str, value: Any) -> Any:
    """A field or parts as they are; a path or a table in memory, read.

    name : str
        The argument's, for messages.
    value : Field, Parts, ScalarField, path or table
        A table is anything with columns by their names: astropy, pandas, polars, Arrow.
    """
    if isinstance(value, SourcesWithErrors | Parts):
        return value
    if is_readable(value):
        return read_field(value)
    raise FieldError(
        f"{name} is a Field, parts of one (vsh.io.catalogue.parts), a path or a table of a catalogue, not "
        f"{type(value).__name__}"
    )
