"""What makes a source unusable, how it is counted, and how it is said."""

import numpy as np

from vsh.errors import FieldError

#: ρ² at and above which a covariance counts as singular.
RHO2_LIMIT = 1 - 1e-6
#: Errors whose squares leave the range of a double are no errors.
SIGMA_RANGE = 1e-140, 1e140


def as_floats(column, value, unit=None):
    """A column as doubles in native byte order, and the mask of what is missing.

    Parameters
    ----------
    column : str — its name, for messages
    value : array, masked array or Quantity
    unit : str — to which a Quantity is converted

    Raises
    ------
    FieldError
        If it holds anything but real numbers, or its unit does not fit.
    """
    if hasattr(value, "to_value"):  # a Quantity, bare or masked, without importing astropy
        try:
            value = value.to_value(unit or "")
        except (ValueError, TypeError) as error:  # astropy's UnitConversionError is one
            raise FieldError(f"{column} cannot be converted to {unit or 'a plain number'}: {error}") from None
    if hasattr(value, "to_numpy") and not hasattr(value, "__array_interface__"):  # pandas' nullable columns
        value = value.to_numpy()
    missing = np.ma.getmaskarray(value) if np.ma.isMaskedArray(value) else getattr(value, "mask", None)
    array = np.asarray(np.ma.getdata(getattr(value, "unmasked", value)))
    if array.dtype.kind == "O":
        missing = np.array([x is None or type(x).__name__ == "NAType" for x in array.ravel()]).reshape(array.shape)
        array = np.where(missing, np.nan, array)
    if array.dtype.kind not in "OiufUS":
        raise FieldError(f"{column} holds {array.dtype.name}, not real numbers")
    if array.dtype.kind in "OUS":
        text = [(row, x) for row, x in enumerate(array.ravel()) if isinstance(x, (str, bytes))]
        if text:
            row, x = next((pair for pair in text if not _is_number(pair[1])), text[0])
            raise FieldError(f"{column} holds text ({str(x)!r} in row {row}); it must be a column of numbers")
    try:
        floats = np.ascontiguousarray(array, dtype=float)
    except (TypeError, ValueError) as error:
        raise FieldError(f"{column} must be a column of numbers: {error}") from None
    return floats, np.zeros(floats.shape, bool) if missing is None else np.broadcast_to(missing, floats.shape)


def check_shapes(columns, expected):
    """Raise FieldError for the first column whose shape is not expected(column)."""
    for column, array in columns.items():
        if array.shape != expected(column):
            raise FieldError(
                f"{column} has shape {array.shape}, expected {expected(column)}: one value for each source"
            )


def faults(lon, lat, motion, sigma, rho, missing=None):
    """Why sources cannot be used: a dict from reason to mask, each source under its first reason.

    Angles in rad; `missing` maps column names to masks.
    """
    reasons = {f"{c} missing": mask for c, mask in (missing or {}).items() if c not in ("redshift", "magnitude")}
    reasons |= {
        "position not finite": ~(np.isfinite(lon) & np.isfinite(lat)),
        "proper motion not finite": ~np.isfinite(motion).all(0),
        "error not finite": ~np.isfinite(sigma).all(0),
        "correlation not finite": ~np.isfinite(rho),
        "σ ≤ 0": ~(sigma > SIGMA_RANGE[0]).all(0),
        "σ too large for a number": ~(sigma < SIGMA_RANGE[1]).all(0),
        "ρ² ≥ 1 − 1e-6": ~(rho * rho < RHO2_LIMIT),
        "|dec| > 90°": ~(np.abs(lat) <= np.pi / 2 * (1 + 1e-14)),
    }
    taken = np.zeros(lon.shape, bool)
    found = {}
    for reason, mask in reasons.items():
        first = mask & ~taken
        if first.any():
            found[reason] = first
            taken |= mask
    return found


class Refusals(str):
    """A note that says how many rows were left out and why; those of several tables can be added up."""

    __slots__ = ("counts", "total")

    def __new__(cls, counts, total):
        reasons = "; ".join(f"{reason}: {count}" for reason, count in counts.items())
        note = super().__new__(cls, f"left out {sum(counts.values())} of {total} rows: {reasons}")
        note.counts, note.total = counts, total
        return note


def merge_notes(*groups):
    """One tuple of notes: repeated words once, the rows left out of different tables apart."""
    notes = {}
    for note in (note for group in groups for note in group):
        notes[id(note) if isinstance(note, Refusals) else note] = note
    return tuple(notes.values())


def sum_refusals(notes):
    """The notes with all rows that were left out in one line."""
    refusals = [note for note in notes if isinstance(note, Refusals)]
    if len(refusals) < 2:
        return tuple(notes)
    counts = {}
    for note in refusals:
        for reason, count in note.counts.items():
            counts[reason] = counts.get(reason, 0) + count
    others = tuple(note for note in notes if not isinstance(note, Refusals))
    return (*others, Refusals(counts, sum(note.total for note in refusals)))


def refuse(found, n, on_bad="raise"):
    """The sources to keep, and a note about the others.

    Raises
    ------
    FieldError
        With `on_bad="raise"` if there are any; always if none is left.
    """
    if n == 0:
        raise FieldError("the catalogue is empty: there are no sources to use")
    bad = np.zeros(n, bool)
    for mask in found.values():
        bad |= mask
    count = int(bad.sum())
    if not count:
        return slice(None), ()
    parts = "; ".join(f"{reason}: {mask.sum()} ({_rows(mask)})" for reason, mask in found.items())
    said = f"{count} of {n} rows cannot be used: {parts}"
    if count == n:
        raise FieldError(f"{said}. No row is left")
    if on_bad == "raise":
        raise FieldError(f'{said}. Mend them, or leave them out with on_bad="drop" (--on-bad drop)')
    return ~bad, (Refusals({reason: int(mask.sum()) for reason, mask in found.items()}, n),)


def _rows(mask, most=5):
    """The first rows of a mask, counted from 0."""
    rows = np.flatnonzero(mask)
    listed = ", ".join(map(str, rows[:most]))
    return f"row{'s' * (rows.size > 1)} {listed}{', …' * (rows.size > most)}"


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
