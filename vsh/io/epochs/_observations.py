"""Observations along scan from files of epoch astrometry, in the columns of the draft of Gaia DR4's data model.

Columns of arrays become one matrix each, from every container of tables: lists, masked arrays, words of JSON. Bits 12
to 14 of a transit_id tell the row of CCDs, 1 to 7, and bits 15 and 16 the field of view, by a code that the times
between transits decide. A draft of the numbering (GAIA-C3-TN-UB-JP-011, p. 9) has 1 for the preceding one and 2 for the
following one; the published epochs of Gaia BH3 have 0 and 1. Gaia turns once in six hours, and its fields are 106.5°
apart: a source is seen 106.5 minutes after the preceding field in the following one, and 253.5 minutes after that in
the preceding one again.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vsh.field import Field
from vsh.io import tables
from vsh.io.archive import DR4
from vsh.io.columns import missing_column, unit_factor
from vsh.io.epochs._solve import COLOUR_PRIOR, make_design_rows, solve_epochs
from vsh.tools.arguments import choice
from vsh.tools.bad_rows import select_usable_rows
from vsh.tools.errors import EmptyFieldError, TableError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import DroppedRows
from vsh.tools.types import BoolArray, FloatArray, IntArray, OnBad, PathName
from vsh.tools.units import DEGREE, JULIAN_YEAR, MAS

#: How truth is written in words.
_TRUTH_WORDS = {"true": True, "t": True, "yes": True, "false": False, "f": False, "no": False}
#: A field that stands for nothing.
_MISSING_WORDS = ("", "null", "none", "nan", "--", "na", "<na>")


def convert_column_to_numbers(values: Any, mask: Any, name: str, label: str) -> tuple[Any, BoolArray, Any]:
    """Turn a column into numbers: (n,), or (n, k) where a row holds several, shorter rows padded.

    Parameters
    ----------
    values : (n,) or (n, k) array
        Numbers; or objects: lists, tuples, (masked) arrays, None, one number each; or text: numbers, words for truth,
        or lists in JSON, as ECSV keeps arrays of any length.
    mask : (n,) or (n, k) bool array or None
        What is missing.
    name, label : str
        The column and the table, for messages.

    Returns
    -------
    values : array
        Numbers or bools.
    mask : bool array
        What is missing, of the same shape.
    padding : (n, k) bool array, or False
        Where a row had no entry: not a missing value, but none at all.

    Raises
    ------
    TableError
        If an entry is no number.
    """
    values = np.asarray(values)
    mask = _broadcast_trailing_axes(np.asarray(False if mask is None else mask, bool), values.shape)
    if values.dtype.kind in "iufb":
        return values, mask, np.False_
    is_null_row = mask.all(axis=tuple(range(1, mask.ndim)))
    if values.dtype.kind in "SU":
        words = np.char.decode(values, "utf-8", "replace") if values.dtype.kind == "S" else values
        entries = [_parse_list_or_word(word, name, label) for word in words]
    elif values.dtype.kind == "O" and values.ndim == 1:
        entries = list(values)
    else:
        raise TableError(f"{label}: column {name!r} holds {values.dtype.name}, not numbers")
    is_null_row = is_null_row | np.array([entry is None for entry in entries], bool)
    entries = [None if is_null else entry for is_null, entry in zip(is_null_row, entries, strict=True)]
    if all(entry is None or np.ndim(entry) == 0 for entry in entries):
        return *_parse_numbers(entries, name, label), np.False_
    masked_rows = [_make_masked_row(entry) for entry in entries]
    lengths = np.array([len(row) for row in masked_rows])
    has_entry = np.arange(lengths.max()) < lengths[:, None]
    filled_rows = [row for row in masked_rows if len(row)]
    if all(row.dtype.kind in "iufb" for row in filled_rows) and len({row.dtype.kind for row in filled_rows}) == 1:
        numbers = np.concatenate([row.data for row in filled_rows])
        is_masked = np.concatenate([np.ma.getmaskarray(row) for row in filled_rows])
    else:
        numbers, is_masked = _parse_numbers([entry for row in filled_rows for entry in _list_entries(row)], name, label)
    matrix, is_missing_entry = np.zeros(has_entry.shape, numbers.dtype), np.zeros(has_entry.shape, bool)
    matrix[has_entry], is_missing_entry[has_entry] = numbers, is_masked
    # A row without a list, as of a transit whose arrays are null, is missing and no padding.
    is_missing_entry[is_null_row] = True
    return matrix, is_missing_entry, ~has_entry & ~is_null_row[:, None]


def _broadcast_trailing_axes(array, shape):
    """Broadcast an array along the trailing axes of a shape: what a transit has once, all its CCDs have."""
    return np.broadcast_to(array.reshape(array.shape + (1,) * (len(shape) - array.ndim)), shape)


def _make_masked_row(row_entry):
    """Make a masked array of the entries of a row, an empty one of None."""
    if row_entry is None:
        return np.ma.array(np.zeros(0))
    return np.ma.atleast_1d(np.ma.asarray(row_entry)).ravel()


def _list_entries(row):
    """List the entries of a row, None where they are masked."""
    return [None if masked else entry for entry, masked in zip(row.data.tolist(), np.ma.getmaskarray(row), strict=True)]


def _parse_numbers(entries, name, label):
    """Parse a list of numbers or bools, and find where there is none; integers keep all their digits."""
    is_missing = np.array([_is_missing(entry) for entry in entries], bool)
    parsed = [_parse_bool_or_number(entry) for entry, missing in zip(entries, is_missing, strict=True) if not missing]
    dtype_kinds = {"b" if isinstance(entry, (bool, np.bool_)) else np.asarray(entry).dtype.kind for entry in parsed}
    if not dtype_kinds <= set("iufb"):
        non_number = next(entry for entry in parsed if np.asarray(entry).dtype.kind not in "iufb")
        raise TableError(f"{label}: column {name!r} holds {non_number!r}, which is no number")
    dtype: Any = bool if dtype_kinds == {"b"} else np.int64 if dtype_kinds <= set("iu") and dtype_kinds else float
    numbers = np.zeros(len(entries), dtype)
    if dtype is float:
        numbers[is_missing] = np.nan
    try:
        numbers[~is_missing] = np.array(parsed, dtype) if parsed else numbers[~is_missing]
    except OverflowError:
        raise TableError(f"{label}: column {name!r} holds an integer of more than 64 bits") from None
    return numbers, is_missing


def _is_missing(entry):
    if entry is None or entry is np.ma.masked or type(entry).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(entry, str) and entry.strip().lower() in _MISSING_WORDS


def _parse_bool_or_number(entry):
    """Parse a word as a bool or a number; what is neither stays as it is."""
    if not isinstance(entry, str):
        return entry
    word = entry.strip().lower()
    if word in _TRUTH_WORDS:
        return _TRUTH_WORDS[word]
    for number_type in (int, float):
        with suppress(ValueError):
            return number_type(word)
    return entry


#: Values of lists as Python, NumPy and pandas write them, and as JSON has them.
_JSON_FORMS = {
    r"\bTrue\b": "true", r"\bFalse\b": "false", r"\bNone\b": "null", r"(?i)\bnan\b": "NaN", r"\binf\b": "Infinity",
    r"(\d)\.(?=[,\]\s])": r"\1.0",
}  # fmt: skip


def _parse_list_or_word(word, name, label):
    """Parse text as a list where it writes one out; a word is stripped of blanks."""
    word = str(word).strip()
    if not word.startswith(("[", "(", "{")):
        return word
    json_text = "[" + word[1:-1] + "]"
    for pattern, json_form in _JSON_FORMS.items():
        json_text = re.sub(pattern, json_form, json_text)
    try:
        return json.loads(json_text)
    except ValueError:
        if "," not in json_text:  # as NumPy prints arrays
            return json_text[1:-1].split()
        raise TableError(f"{label}: column {name!r} holds {word[:40]!r}, which is no list of numbers") from None


#: From the preceding field to the following one, and back [minutes]; and by how much a pair may be off.
_SHORT_GAP, _LONG_GAP, _TOLERANCE = 106.5, 253.5, 4.0
#: Codes of the preceding and of the following field where times decide nothing.
_CODES = {(0, 1): "as in the epochs of Gaia BH3", (1, 2): "as in the draft of DR4's data model"}


def find_fields_of_view(transit_id: Any, source: Any, time: Any) -> tuple[Any, str | None]:
    """Find the field of view of each observation.

    Parameters
    ----------
    transit_id : (k,) int array
        Number of the transit of each observation, with its field of view in two bits.
    source : (k,) array
        Source of each observation.
    time : (k,) array
        [ns]

    Returns
    -------
    view : (k,) int array or None
        +1 the preceding field, −1 the following one; None where it cannot be told.
    note : str or None
        How it was decided.
    """
    view_codes = (np.asarray(transit_id, np.int64) >> 15) & 3
    codes = tuple(int(unique_code) for unique_code in np.unique(view_codes))
    if len(codes) > 2:
        return None, (
            f"transit_id has the codes {', '.join(map(str, codes))} in bits 15 and 16, more than there are fields of "
            "view: it is not taken from there"
        )
    earlier, later, gaps = _pair_neighbouring_transits(transit_id, source, time)
    near_short, near_long = np.abs(gaps - _SHORT_GAP) < _TOLERANCE, np.abs(gaps - _LONG_GAP) < _TOLERANCE
    # Which code comes first of a short pair, or last of a long one, is that of the preceding field.
    leading = np.r_[view_codes[earlier[near_short]], view_codes[later[near_long]]]
    trailing = np.r_[view_codes[later[near_short]], view_codes[earlier[near_long]]]
    is_distinct = leading != trailing
    if is_distinct.any():
        distinct_codes, counts = np.unique(leading[is_distinct], return_counts=True)
        preceding, n_agreeing = int(distinct_codes[counts.argmax()]), int(counts.max())
        if n_agreeing < 0.9 * len(leading):
            return None, (
                f"transit_id contradicts the times between transits in {len(leading) - n_agreeing} of {len(leading)} "
                "pairs: the field of view is not taken from there"
            )
        note = (
            f"fields of view: code {preceding} of transit_id is the preceding one, by {n_agreeing} of {len(leading)} "
            "pairs of transits 106.5 or 253.5 minutes apart"
        )
        return np.where(view_codes == preceding, 1, -1), note
    if codes in _CODES:
        return np.where(view_codes == codes[0], 1, -1), (
            f"fields of view: code {codes[0]} of transit_id is taken as the preceding one, {_CODES[codes]}; no two "
            "transits are near enough to tell"
        )
    if codes in ((0,), (2,)):
        return np.full(len(view_codes), 1 if codes == (0,) else -1), (
            f"fields of view: all transits have code {codes[0]} of transit_id, taken as the "
            f"{'preceding' if codes == (0,) else 'following'} one"
        )
    return None, (
        f"transit_id has code {' and '.join(map(str, codes))} alone in bits 15 and 16, which is the preceding field of "
        "view by one numbering and the following one by another: it is not taken from there"
    )


def _pair_neighbouring_transits(transit_id, source_index, time):
    """Pair an observation of each transit with one of the source's next one, and the time between them. [minutes]"""
    order = np.lexsort([time, source_index])
    is_transit_start = np.r_[True, (np.diff(np.asarray(transit_id)[order]) != 0) | (np.diff(source_index[order]) != 0)]
    starts = order[is_transit_start]
    is_same_source = source_index[starts][1:] == source_index[starts][:-1]
    gaps = np.diff(time[starts]) / 6e10
    return starts[:-1][is_same_source], starts[1:][is_same_source], gaps[is_same_source]


#: What is needed of each observation; arrays of the CCDs of a transit, or a row each.
_NEEDED_COLUMNS = (
    "source_id", "obs_time_tcb", "centroid_pos_al", "centroid_pos_error_al", "scan_pos_angle", "parallax_factor_al",
    "ra0", "dec0",
)  # fmt: skip
_EXCESS = "agis_source_excess_noise"
_OPTIONAL_COLUMNS = ("obs_time_bary_corr", "used_by_agis_al", "transit_id", "colour_factor_al", _EXCESS)
_RA_DEC = ("ra0", "dec0")
#: Parts of the observations: the attribute that tells them, and its value there.
_PARTS = {"field of view 1": ("view", 1), "field of view 2": ("view", -1)}
_PARTS |= {f"CCD row {row}": ("row", row) for row in range(1, 8)}
#: CCDs of a transit with the sky mapper's, which is the first and never used.
_CCD_SLOTS = 10
#: What columns without a unit are in, and others are turned to.
_UNITS = {"obs_time_tcb": "ns", "obs_time_bary_corr": "ns", "centroid_pos_al": "mas", "centroid_pos_error_al": "mas",
          "scan_pos_angle": "deg", "ra0": "deg", "dec0": "deg", _EXCESS: "mas"}  # fmt: skip
_DAY = 86400e9  # [ns]
_YEAR = 365.25 * _DAY
#: J2010.0, from which times are counted, as Julian dates and modified ones; and how far from it such dates are known.
_DATE_ORIGINS, _DATE_RANGE = {"Julian dates": 2455197.5, "modified Julian dates": 55197.0}, 20 * 365.25


@dataclass(frozen=True, eq=False)
class Observations(Frozen):
    """Positions along scan of n sources, k in all.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Where the sources are. [rad, ICRS]
    source : (k,) int array
        Source of each observation, from 0, rising.
    time : (k,) array
        Since the reference epoch. [yr]
    design : (5, k) array
        ∂w by Δα*, Δδ, ϖ, µ_α*, µ_δ (`make_design_rows`): its first two rows are the direction of the scan.
    position, error : (k,) arrays
        w along scan, and its standard error. [µas]
    name : (n,) array
        Name of the sources.
    notes : tuple of str
        What was not used.
    view : (k,) int array or None
        Field of view of each observation: +1 the preceding, −1 the following one; None where it is not known.
    colour : (k,) array or None
        Colour factor, −∂w by the effective wavenumber; None where the table has none, or zeros alone. [µas µm]
    excess_noise : (k,) array or None
        The excess noise that AGIS added to the errors of each source's observations in quadrature; None where the table
        has none. [µas]
    row : (k,) int array or None
        Row of CCDs of each observation, 1 to 7; None where it is not known.
    """

    lon: FloatArray
    lat: FloatArray
    source: IntArray
    time: FloatArray
    design: FloatArray
    position: FloatArray
    error: FloatArray
    name: Any
    notes: tuple[str, ...] = ()
    view: IntArray | None = None
    colour: FloatArray | None = None
    excess_noise: FloatArray | None = None
    row: IntArray | None = None

    def select(self, where: str) -> "Observations":
        """Observations of one field of view or one row of CCDs, of the sources that have some.

        Parameters
        ----------
        where : {"field of view 1", "field of view 2", "CCD row 1", …, "CCD row 7"}
            The preceding field is the first.

        Raises
        ------
        ParameterError
            If there is no such part.
        TableError
            If nothing tells them.
        """
        part = choice("where", where, tuple(_PARTS))
        attribute, value = _PARTS[part]
        if (part_numbers := getattr(self, attribute)) is None:
            kind = "field of view" if attribute == "view" else "CCD row"
            raise TableError(f"no transit_id tells the {kind} of an observation, so none is of {part}")
        is_of_part = part_numbers == value
        if not is_of_part.any():
            raise EmptyFieldError(f"no observation is of {part}")
        source_numbers, source_index = np.unique(self.source[is_of_part], return_inverse=True)
        sources = {name: getattr(self, name)[source_numbers] for name in ("lon", "lat", "name")}
        attributes = ((entry.name, getattr(self, entry.name)) for entry in fields(self) if entry.name not in sources)
        observed = {name: values[..., is_of_part] for name, values in attributes if isinstance(values, np.ndarray)}
        n_lost = len(self.lon) - len(source_numbers)
        note = f"epochs: {is_of_part.sum()} of {len(is_of_part)} observations are of {part}"
        note += f"; {n_lost} sources have none" * bool(n_lost)
        return replace(self, **sources | observed | {"source": source_index}, notes=(*self.notes, note))

    def by_transit(self, gap: float = 60.0) -> "Observations":
        """Average the CCDs of each crossing of the field, weighted, into one observation.

        Parameters
        ----------
        gap : float
            Observations of a source by less apart are of one crossing, be it with several transit_ids. [s]
        """
        order = np.lexsort([self.time, self.source])
        source, time = self.source[order], self.time[order]
        is_crossing_start = np.r_[True, (np.diff(source) > 0) | (np.diff(time) > gap / JULIAN_YEAR)]
        if is_crossing_start.all() and np.array_equal(order, np.arange(len(order))):
            return self
        crossing, starts = np.cumsum(is_crossing_start) - 1, order[is_crossing_start]
        weight = 1 / self.error[order] ** 2
        weight_sums = np.bincount(crossing, weight)

        def average(values):
            return np.bincount(crossing, weight * values[order]) / weight_sums

        known = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        known = {name: values for name, values in known.items() if values is not None}
        means = {name: average(known[name]) for name in ("time", "position", "colour", "excess_noise") if name in known}
        first_values = {name: known[name][starts] for name in ("source", "view", "row") if name in known}
        design = np.array([average(row) for row in self.design])
        return replace(self, **means, **first_values, design=design, error=1 / np.sqrt(weight_sums))


def epoch_files(path: PathName) -> list[Path]:
    """The files of epochs at a path: itself, or every table of a folder in the order of their names.

    Parameters
    ----------
    path : str or Path
        A file or a folder.

    Raises
    ------
    TableError
        If a folder holds no tables, or those of several formats.
    """
    location = Path(path)
    return tables.files_of(location) if location.is_dir() else [location]


def iterate_observations(path: PathName, *, positions: Any = None) -> Iterator["Observations"]:
    """Read the observations of the files at a path, one file after the other, by transit.

    A batch of the archive may hold no observation that can be used; it is passed over.

    Parameters
    ----------
    path : str or Path
        A file or a folder.
    positions : str, Path or table, optional
        As for `read_epochs`.

    Raises
    ------
    EmptyFieldError
        If no file holds an observation that can be used.
    """
    files, errors = epoch_files(path), []
    for file in files:
        try:
            yield read_observations(file, positions=positions).by_transit()
        except EmptyFieldError as error:
            errors.append(error)
    if errors and len(errors) == len(files):
        raise errors[0]


def read_observations(
    source: Any, *, epoch: float = DR4.epoch, columns: Mapping[str, str] | None = None, positions: Any = None
) -> Observations:
    """Read every observation of a table of epoch astrometry.

    Parameters
    ----------
    source, epoch, columns, positions
        As for `read_epochs`.

    Raises
    ------
    TableError
        If a column is missing or holds no numbers, or a source has no position.
    """
    table_source = tables.open_table(source)
    # ESA's internal files call obs_time_tcb obsTimeTcb.
    spellings = {name.replace("_", "").lower(): name for name in reversed(table_source.names)}
    expected_columns = {
        name: (columns or {}).get(
            name, name if name in table_source.names else spellings.get(name.replace("_", ""), name)
        )
        for name in (*_NEEDED_COLUMNS, *_OPTIONAL_COLUMNS)
    }
    for name in _NEEDED_COLUMNS:
        if expected_columns[name] not in table_source.names and not (name in _RA_DEC and positions is not None):
            remedy = (
                "; positions= (vsh-waves --positions), a table of source_id, ra, dec, gives them"
                if name in _RA_DEC
                else ""
            )
            raise TableError(f"{table_source.label}: {missing_column(expected_columns[name], table_source)}{remedy}")
    if positions is not None:
        for name in _RA_DEC:
            expected_columns.pop(name)
    column_names = {name: column for name, column in expected_columns.items() if column in table_source.names}
    twins = [column for column in column_names.values() if column in table_source.twins]
    if set(twins) - {"used_by_agis_al"}:
        raise TableError(f"{table_source.label}: several columns are called {', '.join(twins)}: rename all but one")
    unit_factors = {
        name: unit_factor(column, table_source.units.get(column), _UNITS[name])
        for name, column in column_names.items()
        if name in _UNITS
    }
    values = table_source.columns(tuple(column_names.values()))
    columns_by_role = {name: values[column] for name, column in column_names.items()}
    flat_columns, notes = _flatten_observations(columns_by_role, unit_factors, table_source)
    if twins:  # the first is that along scan, the second across
        notes = (*notes, "several columns are called used_by_agis_al, as in ESA's CSV: the first was read")
    if "obs_time_bary_corr" not in column_names:
        notes = (*notes, "no column obs_time_bary_corr: times are taken as the barycentre's")
    source_ids, first_rows, source_index = np.unique(flat_columns["source_id"], return_index=True, return_inverse=True)
    if positions is None:
        lon, lat = flat_columns["ra0"][first_rows] * DEGREE, flat_columns["dec0"][first_rows] * DEGREE
    else:
        lon, lat = _find_source_positions(source_ids, positions)
    order = np.argsort(source_index, kind="stable")
    source_index, flat_columns = source_index[order], {name: values[order] for name, values in flat_columns.items()}
    view = row = None
    if "view" in flat_columns:
        view, note = find_fields_of_view(flat_columns["view"], source_index, flat_columns["obs_time_tcb"])
        notes = (*notes, *([note] if note else []))
        row = (np.asarray(flat_columns["view"], np.int64) >> 12) & 7
        row = row if row.all() else None  # no row has the number 0: this is another numbering
    time = 2010.0 - epoch + (flat_columns["obs_time_tcb"] + flat_columns.get("obs_time_bary_corr", 0.0)) / _YEAR
    colour, excess_noise = flat_columns.get("colour_factor_al"), flat_columns.get(_EXCESS)
    return Observations(
        lon,
        lat,
        source_index,
        time,
        make_design_rows(flat_columns["scan_pos_angle"] * DEGREE, flat_columns["parallax_factor_al"], time),
        MAS * flat_columns["centroid_pos_al"],
        MAS * flat_columns["centroid_pos_error_al"],
        source_ids,
        (*table_source.notes, *notes),
        view,
        None if colour is None or not colour.any() else MAS * colour,
        None if excess_noise is None else MAS * excess_noise,
        row,
    )


def _find_source_positions(source_ids, positions):
    """Find the positions of sources by their source_id, in another table. [rad]"""
    table_source = tables.open_table(positions)
    column_names = ("source_id", "ra", "dec")
    for name in column_names:
        if name not in table_source.names:
            raise TableError(f"{table_source.label}: {missing_column(name, table_source)}")
    (table_ids, _), (ra, ra_mask), (dec, dec_mask) = (table_source.columns((name,))[name] for name in column_names)
    factors = [unit_factor(name, table_source.units.get(name), "deg") for name in ("ra", "dec")]
    has_position = np.ones(len(table_ids), bool)
    for mask in (ra_mask, dec_mask):
        has_position &= ~np.asarray(mask, bool) if mask is not None else True
    table_ids, ra, dec = table_ids[has_position], ra[has_position] * factors[0], dec[has_position] * factors[1]
    order = np.argsort(table_ids, kind="stable")
    table_rows = np.minimum(np.searchsorted(table_ids[order], source_ids), len(table_ids) - 1)
    absent = source_ids[table_ids[order][table_rows] != source_ids] if len(table_ids) else source_ids
    if len(absent):
        raise TableError(
            f"{table_source.label}: {len(absent)} of {len(source_ids)} sources of the epochs have no position there, "
            f"source_id {absent[0]} for one"
        )
    coordinates = np.asarray(ra, float)[order][table_rows], np.asarray(dec, float)[order][table_rows]
    if not (np.isfinite(coordinates).all() and (np.abs(coordinates[1]) <= 90).all()):
        raise TableError(f"{table_source.label}: some positions are no directions: ra and dec in degrees are expected")
    return coordinates[0] * DEGREE, coordinates[1] * DEGREE


#: No observation is larger, and what is stands for one that was not made: times [ns], positions and errors [mas],
#: angles [deg].
_LARGEST_VALUES = {
    "obs_time_tcb": 100 * _YEAR, "obs_time_bary_corr": 1e14, "centroid_pos_al": 1e9, "centroid_pos_error_al": 1e7,
    "scan_pos_angle": 1e6, "parallax_factor_al": 10.0, "ra0": 720.0, "dec0": 90.0,
    "colour_factor_al": 1e6, _EXCESS: 1e6,
}  # fmt: skip


def _flatten_observations(
    columns_by_role: Mapping[str, Any], unit_factors: Mapping[str, float], table_source: Any
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Flatten columns to one value for each observation that can be used, with notes that count the others."""
    label = table_source.label
    columns, padding = _convert_columns_to_numbers(columns_by_role, table_source)
    repeat_notes = _describe_repeated_rows(columns)
    for name in [name for name in ("colour_factor_al", _EXCESS) if name in columns]:
        values, is_missing = columns[name]
        is_known = np.isfinite(values) & ~is_missing
        if not is_known.any():
            del columns[name]  # null in every row
        elif name == _EXCESS:  # where it is null, AGIS added none
            columns[name] = np.where(is_known, values, 0.0), np.zeros_like(is_missing)
    shape = max((np.shape(values) for values, _ in columns.values()), key=len)
    flat: dict[str, Any] = {}
    is_bad = np.zeros(shape, bool)
    date_notes: tuple[str, ...] = ()
    for name, (values, mask) in columns.items():
        spread_values = _broadcast_trailing_axes(values, shape).ravel()
        is_bad |= _broadcast_trailing_axes(mask, shape)
        if name == "transit_id":
            if values.dtype.kind in "iu":
                flat["view"] = spread_values.astype(np.int64)
        elif name == "obs_time_tcb" and (scale := _find_date_scale(values, mask, table_source.units.get(name))):
            flat[name] = (spread_values - _DATE_ORIGINS[scale]) * _DAY
            date_notes = (f"obs_time_tcb holds {scale}: times are counted from J2010.0",)
        else:
            factor = unit_factors.get(name, 1.0)
            flat[name] = spread_values if factor == 1.0 else spread_values * factor
    notes: tuple[str, ...] = ()
    is_used = flat.pop("used_by_agis_al", np.ones(is_bad.size, bool)).astype(bool)
    if "used_by_agis_al" not in columns and len(shape) == 2 and shape[1] == _CCD_SLOTS:
        is_used = is_used & np.tile(np.arange(_CCD_SLOTS) > 0, shape[0])
        notes = (f"no column used_by_agis_al: the first of {_CCD_SLOTS} CCDs, the sky mapper's, is left out",)
    is_unused = ~is_used
    is_bad = is_bad.ravel()
    if padding.any():  # where a transit has fewer CCDs than another there is no observation
        is_observation = ~np.broadcast_to(padding, shape).ravel()
        flat = {name: values[is_observation] for name, values in flat.items()}
        is_bad, is_unused = is_bad[is_observation], is_unused[is_observation]
    for name, values in flat.items():
        if values.dtype.kind == "f" or name in _LARGEST_VALUES:
            is_bad |= ~(np.abs(values.astype(float)) <= _LARGEST_VALUES.get(name, np.inf)) | ~np.isfinite(values)
    is_bad |= ~(flat["centroid_pos_error_al"] > 1e-9) | ~(flat["obs_time_tcb"] > _YEAR)  # no mission was there in 2010
    colour_phrase = ", a colour factor" if "colour_factor_al" in flat else ""
    counts = {
        "not used by AGIS": int(is_unused.sum()),
        f"without a position, an error{colour_phrase} or a time": int((is_bad & ~is_unused).sum()),
    }
    is_usable = ~(is_bad | is_unused)
    note = DroppedRows.of_table({reason: count for reason, count in counts.items() if count}, is_usable.size, is_usable)
    if not is_usable.any():
        error = EmptyFieldError(f"{label}: no observation can be used: {note}")
        error.notes = (note,)
        raise error
    if any(counts.values()):
        notes = (f"observations: {note}".replace(" rows", " observations"), *notes)
    return {name: values[is_usable] for name, values in flat.items()}, (*notes, *date_notes, *repeat_notes)


def _convert_columns_to_numbers(columns_by_role, table_source):
    """Convert columns to numbers with their masks, one or a row of CCDs per transit, and find what is padding."""
    columns: dict[str, Any] = {}
    padding: Any = np.False_
    array_length, array_name = 0, ""
    for name, (values, mask) in columns_by_role.items():
        values, mask, is_padding = convert_column_to_numbers(values, mask, name, table_source.label)
        if values.ndim > 1:
            if array_length and values.shape[1] != array_length:
                raise TableError(
                    f"{table_source.label}: {name!r} has {values.shape[1]} numbers per transit where {array_name!r} "
                    f"has {array_length}: arrays of the CCDs are as long as each other"
                )
            array_length, array_name = values.shape[1], name
        padding = padding | is_padding
        columns[name] = values, mask
    return columns, padding


def _find_date_scale(values, mask, unit):
    """Find the name of the dates that times are, where they are days since JD 0 or since MJD 0; else None."""
    if unit is not None and str(unit).strip() not in ("d", "day", "days", ""):
        return None
    times = values[~mask]
    times = times[times != 0]  # arrays of transits with fewer CCDs are filled up with zeros
    median_time = float(np.nanmedian(times)) if np.size(times) else 0.0
    return next((name for name, origin in _DATE_ORIGINS.items() if abs(median_time - origin) < _DATE_RANGE), None)


def _describe_repeated_rows(columns):
    """Describe how many transits, or observations where rows are these, stand in the table twice."""
    is_flat = np.ndim(columns["centroid_pos_al"][0]) < 2
    key_name = "obs_time_tcb" if is_flat else "transit_id"
    if key_name not in columns:
        return ()
    key_columns = [np.asarray(columns[name][0]) for name in ("source_id", key_name)]
    order = np.lexsort(key_columns)
    source_id, row_id = (values[order] for values in key_columns)
    n_repeated = int(np.sum((source_id[1:] == source_id[:-1]) & (row_id[1:] == row_id[:-1])))
    row_noun = "observations" if is_flat else "transits"
    return (f"warning: {n_repeated} {row_noun} stand in the table twice and count as two",) if n_repeated else ()


def read_epochs(
    source: Any,
    *,
    epoch: float = DR4.epoch,
    robust: bool | None = None,
    pseudocolour: bool = True,
    on_bad: OnBad = "raise",
    columns: Mapping[str, str] | None = None,
    positions: Any = None,
    where: str | None = None,
) -> Field:
    """Solve for five parameters of every source of a table of epoch astrometry.

    Parameters
    ----------
    source : path or table
        A row for each transit with arrays of its CCDs, of one length or not, or a row for each observation: a file of
        any format (VOTable, FITS, Parquet, ECSV, CSV), an astropy Table, pandas, polars or Arrow; with source_id,
        obs_time_tcb [ns since J2010.0; Julian dates are known], centroid_pos_al and its error [mas], scan_pos_angle
        [deg], parallax_factor_al, ra0 and dec0 [deg]; obs_time_bary_corr [ns] and used_by_agis_al where they are.
    epoch : float
        Epoch of the positions; motions hardly depend on it. [Julian year, TCB]
    robust : bool, optional
        Unless given, the solution is DR4's own: observations that AGIS used (used_by_agis_al), with the excess noise
        that it found for the source (agis_source_excess_noise) added to their errors in quadrature. True weights the
        observations anew: outliers have less weight, and an excess noise is estimated from the residuals. False never
        does. A table without a column of excess noise is solved as with True, and a note says so.
    pseudocolour : bool
        Solve for a correction of the effective wavenumber of each source as a sixth parameter, with a prior of 0.085
        µm⁻¹ as in DR4, where the table has colour_factor_al [mas µm].
    on_bad : {"raise", "drop"}
        What to do about sources without a solution.
    columns : dict of str to str, optional
        Other names of these columns.
    positions : path or table, optional
        Where the sources are, by source_id, ra and dec, for files without ra0 and dec0.
    where : {"field of view 1", "field of view 2", "CCD row 1", …, "CCD row 7"}, optional
        Solve by the observations of the preceding (1) or the following field of view alone, or of one row of CCDs,
        which transit_id tells: catalogues whose comparison (`fit.compare.compare_catalogues`) tests the basic angle, or
        the calibration across the field.

    Returns
    -------
    Field
        Motions with their formal errors; its notes count observations that were not used.

    Raises
    ------
    TableError
        If a column is missing or holds no numbers.
    FieldError
        If a source has too few observations, or all in one direction.

    Notes
    -----
    Without colour factors the colour of a source is taken as known, in error by nothing: errors are then too small for
    quasars with strong emission lines. Solutions are those of ESA's gaiasupdate to 1e-3 of their errors, in its default
    mode, which is that of DR4, and with ``robust=True`` in its mode ``compute_excess_noise=True``.
    """
    observations = read_observations(source, epoch=epoch, columns=columns, positions=positions)
    observations = observations if where is None else observations.select(where)
    colour = observations.colour if pseudocolour else None
    error, excess_noise, notes = observations.error, observations.excess_noise, observations.notes
    if robust is None and excess_noise is None:
        notes = (*notes, f"epochs: no column {_EXCESS}: weights and an excess noise of each source are estimated anew")
    robust = excess_noise is None if robust is None else robust
    if excess_noise is not None and not robust:
        error = np.hypot(error, excess_noise)
        notes = (*notes, "epochs: weights as AGIS had them: the observations that it used, with its excess noise")
    solution = solve_epochs(
        observations.source, observations.design, observations.position, error, colour=colour, robust=robust
    )
    lon, lat = observations.lon, observations.lat
    if solution.pseudocolour is not None:
        scatter = f"{np.nanstd(solution.pseudocolour):.2g}"
        notes = (*notes, f"epochs: a pseudocolour of each source, prior ± {COLOUR_PRIOR} µm⁻¹, scatter {scatter} µm⁻¹")
    is_short = solution.observations <= (5 if colour is None else 6)
    least = "six" if colour is None else "seven"
    masks = {f"fewer than {least} observations": is_short, "scans in too few directions": ~solution.solved & ~is_short}
    rows, added_notes = select_usable_rows(masks, len(lon), on_bad, 0, (lon, lat))
    covariance = solution.covariance[rows][:, 3:, 3:]
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    share = 100 * solution.outliers.sum() / max(1, solution.observations.sum())
    if robust:
        notes = (*notes, f"epochs: {share:.2g} % of {solution.observations.sum()} observations have a weight below 0.2")
    motion, correlation = solution.values[rows][:, 3:].T, covariance[:, 0, 1] / (sigma[0] * sigma[1])
    name, notes = observations.name[rows], (*notes, *added_notes)
    return Field(lon[rows], lat[rows], motion, sigma, correlation, name=name, notes=notes)
