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
from vsh.io.epochs._solve import COLOUR_PRIOR, design_row, solve_epochs
from vsh.tools.arguments import choice
from vsh.tools.bad_rows import select_usable
from vsh.tools.errors import EmptyFieldError, TableError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import DroppedRows
from vsh.tools.types import BoolArray, FloatArray, IntArray, OnBad, PathName
from vsh.tools.units import DEGREE, JULIAN_YEAR, MAS

#: How truth is written in words.
_TRUTH = {"true": True, "t": True, "yes": True, "false": False, "f": False, "no": False}
#: A field that stands for nothing.
_NOTHING = ("", "null", "none", "nan", "--", "na", "<na>")


def matrix_of(values: Any, mask: Any, name: str, label: str) -> tuple[Any, BoolArray, Any]:
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
    mask = _spread(np.asarray(False if mask is None else mask, bool), values.shape)
    if values.dtype.kind in "iufb":
        return values, mask, np.False_
    missing = mask.all(axis=tuple(range(1, mask.ndim)))
    if values.dtype.kind in "SU":
        texts = np.char.decode(values, "utf-8", "replace") if values.dtype.kind == "S" else values
        entries = [_parse_text(text, name, label) for text in texts]
    elif values.dtype.kind == "O" and values.ndim == 1:
        entries = list(values)
    else:
        raise TableError(f"{label}: column {name!r} holds {values.dtype.name}, not numbers")
    missing = missing | np.array([entry is None for entry in entries], bool)
    entries = [None if gone else entry for gone, entry in zip(missing, entries, strict=True)]
    if all(entry is None or np.ndim(entry) == 0 for entry in entries):
        return *_numbers(entries, name, label), np.False_
    rows = [_masked_row(entry) for entry in entries]
    lengths = np.array([len(row) for row in rows])
    inside = np.arange(lengths.max()) < lengths[:, None]
    nonempty_rows = [row for row in rows if len(row)]
    if all(row.dtype.kind in "iufb" for row in nonempty_rows) and len({row.dtype.kind for row in nonempty_rows}) == 1:
        flat = np.concatenate([row.data for row in nonempty_rows])
        lost = np.concatenate([np.ma.getmaskarray(row) for row in nonempty_rows])
    else:
        flat, lost = _numbers([x for row in nonempty_rows for x in _as_list(row)], name, label)
    matrix, absent = np.zeros(inside.shape, flat.dtype), np.zeros(inside.shape, bool)
    matrix[inside], absent[inside] = flat, lost
    # A row without a list, as of a transit whose arrays are null, is missing and no padding.
    absent[missing] = True
    return matrix, absent, ~inside & ~missing[:, None]


def _spread(array, shape):
    """An array in a shape with more dimensions: what a transit has once, all its CCDs have."""
    return np.broadcast_to(array.reshape(array.shape + (1,) * (len(shape) - array.ndim)), shape)


def _masked_row(entry):
    """Entries of a row as a masked array; none of None."""
    if entry is None:
        return np.ma.array(np.zeros(0))
    return np.ma.atleast_1d(np.ma.asarray(entry)).ravel()


def _as_list(row):
    """The entries of a row, None where they are masked."""
    return [None if gone else x for x, gone in zip(row.data.tolist(), np.ma.getmaskarray(row), strict=True)]


def _numbers(entries, name, label):
    """Numbers or bools of a list of them, and where there is none; integers keep all their digits."""
    lost = np.array([_is_nothing(entry) for entry in entries], bool)
    values = [_parse_entry(entry) for entry, gone in zip(entries, lost, strict=True) if not gone]
    dtype_kinds = {"b" if isinstance(entry, (bool, np.bool_)) else np.asarray(entry).dtype.kind for entry in values}
    if not dtype_kinds <= set("iufb"):
        wrong = next(entry for entry in values if np.asarray(entry).dtype.kind not in "iufb")
        raise TableError(f"{label}: column {name!r} holds {wrong!r}, which is no number")
    dtype: Any = bool if dtype_kinds == {"b"} else np.int64 if dtype_kinds <= set("iu") and dtype_kinds else float
    numbers = np.zeros(len(entries), dtype)
    if dtype is float:
        numbers[lost] = np.nan
    try:
        numbers[~lost] = np.array(values, dtype) if values else numbers[~lost]
    except OverflowError:
        raise TableError(f"{label}: column {name!r} holds an integer of more than 64 bits") from None
    return numbers, lost


def _is_nothing(entry):
    if entry is None or entry is np.ma.masked or type(entry).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(entry, str) and entry.strip().lower() in _NOTHING


def _parse_entry(entry):
    """A number of a word."""
    if not isinstance(entry, str):
        return entry
    text = entry.strip().lower()
    if text in _TRUTH:
        return _TRUTH[text]
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return entry


#: Values of lists as Python, NumPy and pandas write them, and as JSON has them.
_WRITTEN = {
    r"\bTrue\b": "true", r"\bFalse\b": "false", r"\bNone\b": "null", r"(?i)\bnan\b": "NaN", r"\binf\b": "Infinity",
    r"(\d)\.(?=[,\]\s])": r"\1.0",
}  # fmt: skip


def _parse_text(text, name, label):
    """A word, or the list that it writes out."""
    text = str(text).strip()
    if not text.startswith(("[", "(", "{")):
        return text
    inner = "[" + text[1:-1] + "]"
    for pattern, word in _WRITTEN.items():
        inner = re.sub(pattern, word, inner)
    try:
        return json.loads(inner)
    except ValueError:
        if "," not in inner:  # as NumPy prints arrays
            return inner[1:-1].split()
        raise TableError(f"{label}: column {name!r} holds {text[:40]!r}, which is no list of numbers") from None


#: From the preceding field to the following one, and back [minutes]; and by how much a pair may be off.
_SHORT, _LONG, _CLOSE = 106.5, 253.5, 4.0
#: Codes of the preceding and of the following field where times decide nothing.
_KNOWN = {(0, 1): "as in the epochs of Gaia BH3", (1, 2): "as in the draft of DR4's data model"}


def views_of(transit: Any, source: Any, time: Any) -> tuple[Any, str | None]:
    """Find the field of view of each observation.

    Parameters
    ----------
    transit : (k,) int array
        transit_id.
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
    code = (np.asarray(transit, np.int64) >> 15) & 3
    codes = tuple(int(value) for value in np.unique(code))
    if len(codes) > 2:
        return None, (
            f"transit_id has the codes {', '.join(map(str, codes))} in bits 15 and 16, more than there are fields of "
            "view: it is not taken from there"
        )
    earlier, later, gap = _neighbours(transit, source, time)
    near_short, near_long = np.abs(gap - _SHORT) < _CLOSE, np.abs(gap - _LONG) < _CLOSE
    # Which code comes first of a short pair, or last of a long one, is that of the preceding field.
    leading = np.r_[code[earlier[near_short]], code[later[near_long]]]
    trailing = np.r_[code[later[near_short]], code[earlier[near_long]]]
    is_distinct = leading != trailing
    if is_distinct.any():
        values, counts = np.unique(leading[is_distinct], return_counts=True)
        preceding, agreeing = int(values[counts.argmax()]), int(counts.max())
        if agreeing < 0.9 * len(leading):
            return None, (
                f"transit_id contradicts the times between transits in {len(leading) - agreeing} of {len(leading)} "
                "pairs: the field of view is not taken from there"
            )
        note = (
            f"fields of view: code {preceding} of transit_id is the preceding one, by {agreeing} of {len(leading)} "
            "pairs of transits 106.5 or 253.5 minutes apart"
        )
        return np.where(code == preceding, 1, -1), note
    if codes in _KNOWN:
        return np.where(code == codes[0], 1, -1), (
            f"fields of view: code {codes[0]} of transit_id is taken as the preceding one, {_KNOWN[codes]}; no two "
            "transits are near enough to tell"
        )
    if codes in ((0,), (2,)):
        return np.full(len(code), 1 if codes == (0,) else -1), (
            f"fields of view: all transits have code {codes[0]} of transit_id, taken as the "
            f"{'preceding' if codes == (0,) else 'following'} one"
        )
    return None, (
        f"transit_id has code {' and '.join(map(str, codes))} alone in bits 15 and 16, which is the preceding field of "
        "view by one numbering and the following one by another: it is not taken from there"
    )


def _neighbours(transit, source, time):
    """Observations of each source's transits and of the next one, and the time between them. [minutes]"""
    order = np.lexsort([time, source])
    is_start = np.r_[True, (np.diff(np.asarray(transit)[order]) != 0) | (np.diff(source[order]) != 0)]
    at = order[is_start]
    same_source = source[at][1:] == source[at][:-1]
    gap = np.diff(time[at]) / 6e10
    return at[:-1][same_source], at[1:][same_source], gap[same_source]


#: What is needed of each observation; arrays of the CCDs of a transit, or a row each.
_COLUMNS = (
    "source_id", "obs_time_tcb", "centroid_pos_al", "centroid_pos_error_al", "scan_pos_angle", "parallax_factor_al",
    "ra0", "dec0",
)  # fmt: skip
_EXCESS = "agis_source_excess_noise"
_OPTIONAL = ("obs_time_bary_corr", "used_by_agis_al", "transit_id", "colour_factor_al", _EXCESS)
_PLACES = ("ra0", "dec0")
#: Parts of the observations: the attribute that tells them, and its value there.
_PARTS = {"field of view 1": ("view", 1), "field of view 2": ("view", -1)}
_PARTS |= {f"CCD row {row}": ("row", row) for row in range(1, 8)}
#: CCDs of a transit with the sky mapper's, which is the first and never used.
_SLOTS = 10
#: What columns without a unit are in, and others are turned to.
_UNITS = {"obs_time_tcb": "ns", "obs_time_bary_corr": "ns", "centroid_pos_al": "mas", "centroid_pos_error_al": "mas",
          "scan_pos_angle": "deg", "ra0": "deg", "dec0": "deg", _EXCESS: "mas"}  # fmt: skip
_DAY = 86400e9  # [ns]
_YEAR = 365.25 * _DAY
#: J2010.0, from which times are counted, as Julian dates and modified ones; and how far from it such dates are known.
_ORIGINS, _FAR = {"Julian dates": 2455197.5, "modified Julian dates": 55197.0}, 20 * 365.25


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
        ∂w by Δα*, Δδ, ϖ, µ_α*, µ_δ (`design_row`): its first two rows are the direction of the scan.
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
        name, value = _PARTS[part]
        if (values := getattr(self, name)) is None:
            kind = "field of view" if name == "view" else "CCD row"
            raise TableError(f"no transit_id tells the {kind} of an observation, so none is of {part}")
        keep = values == value
        if not keep.any():
            raise EmptyFieldError(f"no observation is of {part}")
        present, number = np.unique(self.source[keep], return_inverse=True)
        sources = {name: getattr(self, name)[present] for name in ("lon", "lat", "name")}
        attributes = ((entry.name, getattr(self, entry.name)) for entry in fields(self) if entry.name not in sources)
        observed = {name: values[..., keep] for name, values in attributes if isinstance(values, np.ndarray)}
        lost = len(self.lon) - len(present)
        note = f"epochs: {keep.sum()} of {len(keep)} observations are of {part}"
        note += f"; {lost} sources have none" * bool(lost)
        return replace(self, **sources | observed | {"source": number}, notes=(*self.notes, note))

    def by_transit(self, gap: float = 60.0) -> "Observations":
        """Average the CCDs of each crossing of the field, weighted, into one observation.

        Parameters
        ----------
        gap : float
            Observations of a source by less apart are of one crossing, be it with several transit_ids. [s]
        """
        order = np.lexsort([self.time, self.source])
        source, time = self.source[order], self.time[order]
        is_start = np.r_[True, (np.diff(source) > 0) | (np.diff(time) > gap / JULIAN_YEAR)]
        if is_start.all() and np.array_equal(order, np.arange(len(order))):
            return self
        number, starts = np.cumsum(is_start) - 1, order[is_start]
        weight = 1 / self.error[order] ** 2
        total = np.bincount(number, weight)

        def mean(values):
            return np.bincount(number, weight * values[order]) / total

        return replace(
            self,
            source=self.source[starts],
            time=mean(self.time),
            design=np.array([mean(row) for row in self.design]),
            position=mean(self.position),
            error=1 / np.sqrt(total),
            view=None if self.view is None else self.view[starts],
            row=None if self.row is None else self.row[starts],
            colour=None if self.colour is None else mean(self.colour),
            excess_noise=None if self.excess_noise is None else mean(self.excess_noise),
        )


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
    spelled = {name.replace("_", "").lower(): name for name in reversed(table_source.names)}
    names = {
        name: (columns or {}).get(
            name, name if name in table_source.names else spelled.get(name.replace("_", ""), name)
        )
        for name in (*_COLUMNS, *_OPTIONAL)
    }
    for name in _COLUMNS:
        if names[name] not in table_source.names and not (name in _PLACES and positions is not None):
            remedy = (
                "; positions=, a table of source_id, ra and dec (gaia_source), gives them" if name in _PLACES else ""
            )
            raise TableError(f"{table_source.label}: {missing_column(names[name], table_source)}{remedy}")
    if positions is not None:
        for name in _PLACES:
            names.pop(name)
    column_names = {name: column for name, column in names.items() if column in table_source.names}
    twins = [column for column in column_names.values() if column in table_source.twins]
    if set(twins) - {"used_by_agis_al"}:
        raise TableError(f"{table_source.label}: several columns are called {', '.join(twins)}: rename all but one")
    factors = {
        name: unit_factor(column, table_source.units.get(column), _UNITS[name])
        for name, column in column_names.items()
        if name in _UNITS
    }
    values = table_source.columns(tuple(column_names.values()))
    columns_by_role = {name: values[column] for name, column in column_names.items()}
    flat, notes = _flatten_observations(columns_by_role, factors, table_source)
    if twins:  # the first is that along scan, the second across
        notes = (*notes, "several columns are called used_by_agis_al, as in ESA's CSV: the first was read")
    if "obs_time_bary_corr" not in column_names:
        notes = (*notes, "no column obs_time_bary_corr: times are taken as the barycentre's")
    identifiers, indices, number = np.unique(flat["source_id"], return_index=True, return_inverse=True)
    if positions is None:
        lon, lat = flat["ra0"][indices] * DEGREE, flat["dec0"][indices] * DEGREE
    else:
        lon, lat = _join_positions(identifiers, positions)
    order = np.argsort(number, kind="stable")
    number, flat = number[order], {name: values[order] for name, values in flat.items()}
    view = row = None
    if "view" in flat:
        view, note = views_of(flat["view"], number, flat["obs_time_tcb"])
        notes = (*notes, *([note] if note else []))
        row = (np.asarray(flat["view"], np.int64) >> 12) & 7
        row = row if row.all() else None  # no row has the number 0: this is another numbering
    time = 2010.0 - epoch + (flat["obs_time_tcb"] + flat.get("obs_time_bary_corr", 0.0)) / _YEAR
    colour, excess = flat.get("colour_factor_al"), flat.get(_EXCESS)
    return Observations(
        lon,
        lat,
        number,
        time,
        design_row(flat["scan_pos_angle"] * DEGREE, flat["parallax_factor_al"], time),
        MAS * flat["centroid_pos_al"],
        MAS * flat["centroid_pos_error_al"],
        identifiers,
        (*table_source.notes, *notes),
        view,
        None if colour is None or not colour.any() else MAS * colour,
        None if excess is None else MAS * excess,
        row,
    )


def _join_positions(identifiers, positions):
    """Positions of sources by their source_id, from another table."""
    table_source = tables.open_table(positions)
    names = ("source_id", "ra", "dec")
    for name in names:
        if name not in table_source.names:
            raise TableError(f"{table_source.label}: {missing_column(name, table_source)}")
    (source_ids, _), (ra, no_ra), (dec, no_dec) = (table_source.columns((name,))[name] for name in names)
    factors = [unit_factor(name, table_source.units.get(name), "deg") for name in ("ra", "dec")]
    has_position = np.ones(len(source_ids), bool)
    for mask in (no_ra, no_dec):
        has_position &= ~np.asarray(mask, bool) if mask is not None else True
    source_ids, ra, dec = source_ids[has_position], ra[has_position] * factors[0], dec[has_position] * factors[1]
    order = np.argsort(source_ids, kind="stable")
    at = np.minimum(np.searchsorted(source_ids[order], identifiers), len(source_ids) - 1)
    lost = identifiers[source_ids[order][at] != identifiers] if len(source_ids) else identifiers
    if len(lost):
        raise TableError(
            f"{table_source.label}: {len(lost)} of {len(identifiers)} sources of the epochs have no position there, "
            f"source_id {lost[0]} for one"
        )
    coordinates = np.asarray(ra, float)[order][at], np.asarray(dec, float)[order][at]
    if not (np.isfinite(coordinates).all() and (np.abs(coordinates[1]) <= 90).all()):
        raise TableError(f"{table_source.label}: some positions are no directions: ra and dec in degrees are expected")
    return coordinates[0] * DEGREE, coordinates[1] * DEGREE


#: No observation is larger, and what is stands for one that was not made: times [ns], positions and errors [mas],
#: angles [deg].
_MOST = {
    "obs_time_tcb": 100 * _YEAR, "obs_time_bary_corr": 1e14, "centroid_pos_al": 1e9, "centroid_pos_error_al": 1e7,
    "scan_pos_angle": 1e6, "parallax_factor_al": 10.0, "ra0": 720.0, "dec0": 90.0,
    "colour_factor_al": 1e6, _EXCESS: 1e6,
}  # fmt: skip


def _flatten_observations(
    table: Mapping[str, Any], factors: Mapping[str, float], table_source: Any
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Columns with a value for each observation that can be used, and a note that counts the others."""
    label = table_source.label
    columns, padding = _matrices(table, table_source)
    repeat_notes = _note_on_repeated_rows(columns)
    for name in [name for name in ("colour_factor_al", _EXCESS) if name in columns]:
        values, absent = columns[name]
        is_given = np.isfinite(values) & ~absent
        if not is_given.any():
            del columns[name]  # null in every row
        elif name == _EXCESS:  # where it is null, AGIS added none
            columns[name] = np.where(is_given, values, 0.0), np.zeros_like(absent)
    shape = max((np.shape(values) for values, _ in columns.values()), key=len)
    flat: dict[str, Any] = {}
    bad = np.zeros(shape, bool)
    times: tuple[str, ...] = ()
    for name, (values, mask) in columns.items():
        spread_values = _spread(values, shape).ravel()
        bad |= _spread(mask, shape)
        if name == "transit_id":
            if values.dtype.kind in "iu":
                flat["view"] = spread_values.astype(np.int64)
        elif name == "obs_time_tcb" and (scale := _date_scale(values, mask, table_source.units.get(name))):
            flat[name] = (spread_values - _ORIGINS[scale]) * _DAY
            times = (f"obs_time_tcb holds {scale}: times are counted from J2010.0",)
        else:
            factor = factors.get(name, 1.0)
            flat[name] = spread_values if factor == 1.0 else spread_values * factor
    notes: tuple[str, ...] = ()
    is_used = flat.pop("used_by_agis_al", np.ones(bad.size, bool)).astype(bool)
    if "used_by_agis_al" not in columns and len(shape) == 2 and shape[1] == _SLOTS:
        is_used = is_used & np.tile(np.arange(_SLOTS) > 0, shape[0])
        notes = (f"no column used_by_agis_al: the first of {_SLOTS} CCDs, the sky mapper's, is left out",)
    is_unused = ~is_used
    bad = bad.ravel()
    if padding.any():  # where a transit has fewer CCDs than another there is no observation
        is_observation = ~np.broadcast_to(padding, shape).ravel()
        flat, bad, is_unused = (
            {name: values[is_observation] for name, values in flat.items()},
            bad[is_observation],
            is_unused[is_observation],
        )
    for name, values in flat.items():
        if values.dtype.kind == "f" or name in _MOST:
            bad |= ~(np.abs(values.astype(float)) <= _MOST.get(name, np.inf)) | ~np.isfinite(values)
    bad |= ~(flat["centroid_pos_error_al"] > 1e-9) | ~(flat["obs_time_tcb"] > _YEAR)  # no mission was there in 2010
    missing_colour = ", a colour factor" if "colour_factor_al" in flat else ""
    counts = {
        "not used by AGIS": int(is_unused.sum()),
        f"without a position, an error{missing_colour} or a time": int((bad & ~is_unused).sum()),
    }
    keep = ~(bad | is_unused)
    note = DroppedRows.of_table({reason: count for reason, count in counts.items() if count}, keep.size, keep)
    if not keep.any():
        error = EmptyFieldError(f"{label}: no observation can be used: {note}")
        error.notes = (note,)
        raise error
    if any(counts.values()):
        notes = (f"observations: {note}".replace(" rows", " observations"), *notes)
    return {name: values[keep] for name, values in flat.items()}, (*notes, *times, *repeat_notes)


def _matrices(table, table_source):
    """Convert columns to numbers, one row or matrix of CCDs per transit, and a mask of missing CCDs."""
    columns: dict[str, Any] = {}
    padding: Any = np.False_
    width, array_name = 0, ""
    for name, (values, mask) in table.items():
        values, mask, absent = matrix_of(values, mask, name, table_source.label)
        if values.ndim > 1:
            if width and values.shape[1] != width:
                raise TableError(
                    f"{table_source.label}: {name!r} has {values.shape[1]} numbers per transit where {array_name!r} "
                    f"has {width}: arrays of the CCDs are as long as each other"
                )
            width, array_name = values.shape[1], name
        padding = padding | absent
        columns[name] = values, mask
    return columns, padding


def _date_scale(values, mask, unit):
    """The name of the dates that times are, where they are days since JD 0 or since MJD 0; else None."""
    if unit is not None and str(unit).strip() not in ("d", "day", "days", ""):
        return None
    times = values[~mask]
    times = times[times != 0]  # arrays of transits with fewer CCDs are filled up with zeros
    middle = float(np.nanmedian(times)) if np.size(times) else 0.0
    return next((name for name, origin in _ORIGINS.items() if abs(middle - origin) < _FAR), None)


def _note_on_repeated_rows(columns):
    """A note on transits, or on observations where rows are these, that stand in the table twice."""
    is_flat = np.ndim(columns["centroid_pos_al"][0]) < 2
    mark = "obs_time_tcb" if is_flat else "transit_id"
    if mark not in columns:
        return ()
    pair = [np.asarray(columns[name][0]) for name in ("source_id", mark)]
    order = np.lexsort(pair)
    source, row = (values[order] for values in pair)
    twice = int(np.sum((source[1:] == source[:-1]) & (row[1:] == row[:-1])))
    rows = "observations" if is_flat else "transits"
    return (f"warning: {twice} {rows} stand in the table twice and count as two",) if twice else ()


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
    error, excess, notes = observations.error, observations.excess_noise, observations.notes
    if robust is None and excess is None:
        notes = (*notes, f"epochs: no column {_EXCESS}: weights and an excess noise of each source are estimated anew")
    robust = excess is None if robust is None else robust
    if excess is not None and not robust:
        error = np.hypot(error, excess)
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
    lost = {f"fewer than {least} observations": is_short, "scans in too few directions": ~solution.solved & ~is_short}
    keep, added_notes = select_usable(lost, len(lon), on_bad, 0, (lon, lat))
    covariance = solution.covariance[keep][:, 3:, 3:]
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    share = 100 * solution.outliers.sum() / max(1, solution.observations.sum())
    if robust:
        notes = (*notes, f"epochs: {share:.2g} % of {solution.observations.sum()} observations have a weight below 0.2")
    return Field(
        lon[keep],
        lat[keep],
        solution.values[keep][:, 3:].T,
        sigma,
        covariance[:, 0, 1] / (sigma[0] * sigma[1]),
        name=observations.name[keep],
        notes=(*notes, *added_notes),
    )
