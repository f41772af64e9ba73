"""What makes a source unusable, how it is counted, and how it is said."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from vsh.tools.errors import EmptyFieldError, FieldError
from vsh.tools.notes import DOUBT, CodedNote, DroppedRows
from vsh.tools.printing import one_line_text
from vsh.tools.types import BoolArray, FloatArray, OnBad

#: The smallest and the largest of an array.
Span: TypeAlias = tuple[float, float]
#: ρ² at and above which a covariance counts as singular.
RHO2_LIMIT = 1 - 1e-6
#: Correlations closer to zero need no square.
_RHO_SAFE = 0.999
#: Errors whose squares leave the range of a double are no errors.
SIGMA_RANGE = 1e-140, 1e140
_DOUBLE = np.dtype(float)


def as_floats_and_mask(
    column: str, value: Any, unit: Any = None, first_row: int | FloatArray = 0
) -> tuple[FloatArray, BoolArray]:
    """A column as doubles in native byte order, and the mask of what is missing; numbers may be written as text."""
    if type(value) is np.ndarray and value.dtype == _DOUBLE and value.ndim and value.flags.c_contiguous:
        return value, _make_false_mask(value.shape)  # at once: small parts wait for this more than for their sums
    if callable(value) or isinstance(value, dict) or value is None:
        raise FieldError(f"{column} must be a column of numbers, not {type(value).__name__}")
    if hasattr(value, "to_value"):  # a Quantity, bare or masked, without importing astropy
        try:
            value = value.to_value(unit or "")
        except (ValueError, TypeError) as error:  # astropy's UnitConversionError is one
            raise FieldError(f"{column} cannot be converted to {unit or 'a plain number'}: {error}") from None
    elif unit and hasattr(getattr(value, "unit", None), "to"):  # a column of an astropy Table
        try:
            value = value * value.unit.to(unit)
        except (ValueError, TypeError) as error:
            raise FieldError(f"{column} cannot be converted to {unit}: {error}") from None
    if hasattr(value, "to_numpy") and not hasattr(value, "__array_interface__"):  # pandas' nullable columns
        value = value.to_numpy()
    is_missing = np.ma.getmaskarray(value) if np.ma.isMaskedArray(value) else getattr(value, "mask", None)
    array = np.asarray(np.ma.getdata(getattr(value, "unmasked", value)))
    if array.dtype.kind == "O":
        is_na = np.array([x is None or type(x).__name__ == "NAType" for x in array.ravel()], bool).reshape(array.shape)
        is_missing = is_na if is_missing is None else is_na | is_missing
        array = np.where(is_missing, np.nan, array)
    if array.dtype.kind not in "OiufUS":
        raise FieldError(f"{column} holds {array.dtype.name}, not real numbers")
    if array.dtype.kind in "OUS":
        array = _parse_number_texts(column, array if is_missing is None else np.where(is_missing, "", array), first_row)
    try:
        floats = np.ascontiguousarray(array, dtype=float)
    except (TypeError, ValueError) as error:
        raise FieldError(f"{column} must be a column of numbers: {error}") from None
    return floats, _make_false_mask(floats.shape) if is_missing is None else np.broadcast_to(is_missing, floats.shape)


def floats_or_nan(column: str, value: Any) -> FloatArray:
    """A column as doubles, nan where they are missing."""
    values, is_missing = as_floats_and_mask(column, value)
    return np.where(is_missing, np.nan, values) if is_missing.any() else values


@lru_cache(maxsize=16)
def _make_false_mask(shape):
    """The mask of a column that has all its values: one False for all rows."""
    return np.broadcast_to(False, shape)


def check_column_shapes(columns: Mapping[str, FloatArray], expected_shape: Callable[[str], tuple[int, ...]]) -> None:
    """Raise FieldError for the first column whose shape is not expected(column)."""
    for column, array in columns.items():
        if array.shape != expected_shape(column):
            raise FieldError(
                f"{column} has shape {array.shape}, expected {expected_shape(column)}: one value for each source"
            )


def find_bad_rows(
    lon: FloatArray,
    lat: FloatArray,
    motion: FloatArray,
    sigma: FloatArray,
    rho: FloatArray,
    further_reasons: Mapping[str, BoolArray] | None = None,
    is_placeholder: BoolArray | None = None,
    turns: int = 2,
    label: str = "proper motion",
    spans: Mapping[str, Span] | None = None,
) -> dict[str, BoolArray]:
    """Reasons why sources cannot be used, the first of a source being the one that counts; `spans` of the arrays where
    they are known."""
    reasons: dict[str, Any] = dict(further_reasons or {})
    masks = [*reasons.values(), *([] if is_placeholder is None else [is_placeholder])]
    limits = {
        "sigma": (sigma, *SIGMA_RANGE),
        "motion": (motion, -SIGMA_RANGE[1], SIGMA_RANGE[1]),
        "rho": (rho, -_RHO_SAFE, _RHO_SAFE),
        "lat": (lat, -np.pi / 2, np.pi / 2),
        "lon": (lon, -2 * np.pi * turns, 2 * np.pi * turns),
    }
    column_spans = {} if spans is None else spans
    if not any(_has_marked_row(mask) for mask in masks) and all(
        is_within(column_spans.get(name) or span_of(values), lower, upper)
        for name, (values, lower, upper) in limits.items()
    ):
        return {}
    if is_placeholder is not None:
        reasons[PLACEHOLDER] = is_placeholder | reasons.get(PLACEHOLDER, False)
    return reasons | {
        "position not finite": ~(np.isfinite(lon) & np.isfinite(lat)),
        f"{label} not finite": ~np.isfinite(motion).all(0),
        "error not finite": ~np.isfinite(sigma).all(0),
        "correlation not finite": ~np.isfinite(rho),
        "σ ≤ 0": ~(sigma > 0).all(0),
        "σ too small for a number": ~(sigma > SIGMA_RANGE[0]).all(0),
        "σ too large for a number": ~(sigma < SIGMA_RANGE[1]).all(0),
        f"{label} too large for a number": ~(np.abs(motion) < SIGMA_RANGE[1]).all(0),
        "ρ² ≥ 1 − 1e-6": ~(rho * rho < RHO2_LIMIT),
        "|dec| > 90°": ~(np.abs(lat) <= np.pi / 2 * (1 + 1e-14)),
        f"ra outside −{360 * turns}° … {360 * turns}°": ~(np.abs(lon) <= 2 * np.pi * turns * (1 + 1e-14)),
    }


def span_of(values: FloatArray) -> Span:
    """The smallest and the largest; nan where there is none, or one is not a number."""
    return (float(values.min()), float(values.max())) if values.size else (np.nan, np.nan)


def joint_span(spans: Mapping[str, Span], names: Sequence[str], factor: float) -> Span:
    """Span of several columns multiplied by a factor; nan where one is."""
    lower, upper = np.transpose([spans[name] for name in names]) * factor
    return float(lower.min()), float(upper.max())


def _has_marked_row(mask):
    """Return whether a mask marks any row; where one number stands for all, it is looked at once."""
    return bool(mask[:1].any() if mask.strides == (0,) else mask.any())


def is_within(span: Span, lower: float, upper: float) -> bool:
    """Return whether all values lie between two limits; not where one is not a number."""
    return bool(span[0] > lower and span[1] < upper)


#: What catalogues write where they have no value; no motion and no error is exactly one of these.
PLACEHOLDER = "a value such as -9999 that marks missing data"
_PLACEHOLDER_VALUES = np.array(
    [9999.0, 9999.9, 9999.99, 32767.0, 32768.0, 99999.0, 999999.0, 2147483647.0, 2147483648.0, 9.99e9, 1e20, 1e30,
     1.6375e30, 1e31]
)  # fmt: skip
#: More motions of exactly (0, 0) than so many are missing values, unless their numbers are rounded.
_FEW_ZEROS = 3
#: The share of the others with one component of zero from which on motions are rounded.
_ROUNDED_SHARE = 0.01
#: These a motion might be; not both components of a source.
_DOUBTFUL = np.array([-9.99, -99.0, -99.9, -99.99, -999.0, -999.9, -999.99, 99.9, 99.99, 999.0, 999.9, 999.99])


def find_placeholder_rows(columns: Mapping[str, FloatArray], spans: Mapping[str, Span] | None = None) -> BoolArray:
    """Rows whose motions or errors are numbers that stand for none: −9999 anywhere, −99 and −999 in both components."""
    column_spans = {name: span_of(values) for name, values in columns.items()} if spans is None else spans
    is_placeholder = np.zeros(len(columns["pmra"]), bool)
    with np.errstate(invalid="ignore"):
        for name, values in columns.items():
            if is_within(column_spans[name], -_PLACEHOLDER_VALUES[0], _PLACEHOLDER_VALUES[0]):
                continue
            is_large = np.abs(values) >= _PLACEHOLDER_VALUES[0]
            if is_large.any():
                is_placeholder[is_large] |= np.isin(np.abs(values[is_large]), _PLACEHOLDER_VALUES)
        has_equal_components = columns["pmra"] == columns["pmdec"]
    if has_equal_components.any():
        is_placeholder[has_equal_components] |= np.isin(columns["pmra"][has_equal_components], _DOUBTFUL)
    return is_placeholder


def find_zero_motion_rows(pmra: FloatArray, pmdec: FloatArray) -> dict[str, BoolArray]:
    """Rows whose motions are exactly (0, 0), where those are more than a few, as a reason to leave them out.

    Rounded motions, some of which are zero in one component alone, are none. Where all are zero, the
    table is of sources that stand still, as a simulation without noise.
    """
    if np.shape(pmra) != np.shape(pmdec) or np.ndim(pmra) != 1:
        return {}
    is_zero = np.ma.filled(np.ma.asarray(pmra) == 0, False), np.ma.filled(np.ma.asarray(pmdec) == 0, False)
    is_null, has_one_zero = is_zero[0] & is_zero[1], is_zero[0] ^ is_zero[1]
    is_rounded = has_one_zero.sum() > max(_ROUNDED_SHARE * (len(is_null) - is_null.sum()), is_null.sum() / 50)
    if not _FEW_ZEROS < is_null.sum() < len(is_null) or is_rounded:
        return {}
    return {"motion of exactly 0 in both components, a mark of missing values": is_null}


def doubtful_motion_notes(
    columns: Mapping[str, FloatArray], spans: Mapping[str, Span] | None = None, row_numbers: Any = None
) -> tuple[str, ...]:
    """A note on motions that are −999 or 99.99, say, in one component: perhaps missing values; they are used."""
    column_spans = {name: span_of(values) for name, values in columns.items()} if spans is None else spans
    if all(is_within(column_spans[name], -50.0, 50.0) for name in ("pmra", "pmdec")):
        return ()
    with np.errstate(invalid="ignore"):
        odd = np.stack([np.isin(columns[name], _DOUBTFUL) & (np.abs(columns[name]) > 50) for name in ("pmra", "pmdec")])
    has_doubtful = odd.any(0)
    if not has_doubtful.any():
        return ()
    doubtful_values = np.unique(np.concatenate([columns[name][mask] for name, mask in zip(("pmra", "pmdec"), odd)]))
    examples = ", ".join(f"{value:g}" for value in doubtful_values[:4])
    count_text = f"{has_doubtful.sum()} row{' has' if has_doubtful.sum() == 1 else 's have'}"
    first_row = has_doubtful.argmax() if row_numbers is None else np.asarray(row_numbers)[has_doubtful.argmax()]
    message = (
        f"warning: {count_text} a motion of {examples} in one component: a mark of missing values? It is used (first: "
        f"row {first_row}); leave such rows out with --where"
    )
    return (CodedNote(message, DOUBT),)


def check_source_columns(noun: Any, float_names: Sequence[str], other_names: Sequence[str]) -> dict[str, FloatArray]:
    """Check the arrays of a noun with one entry a source (lon, lat, motion, sigma, rho, …), and return them by name."""
    for column in ("lon", "lat", "sigma", *({"motion"} if hasattr(noun, "magnitude") else ())):
        if getattr(noun, column) is None:
            raise FieldError(f"{column} is missing")
    lon = as_floats_and_mask("lon", noun.lon)[0]
    arrays = {"rho": np.zeros(lon.shape)}
    for column in ("lon", *float_names):
        if getattr(noun, column) is not None:
            arrays[column] = floats_or_nan(column, getattr(noun, column))
    for column in other_names:
        if getattr(noun, column) is not None:
            arrays[column] = np.asarray(getattr(noun, column))
    shapes = {"motion": (2, lon.size), "sigma": (2, lon.size)}
    check_column_shapes(arrays, lambda column: shapes.get(column, (lon.size,)))
    motion = arrays.get("motion", np.zeros((2, lon.size)))
    select_usable_rows(find_bad_rows(arrays["lon"], arrays["lat"], motion, arrays["sigma"], arrays["rho"]), lon.size)
    return arrays


def select_usable_rows(
    invalid: Mapping[str, BoolArray],
    n: int,
    on_bad: OnBad = "raise",
    first_row: int = 0,
    identifying_arrays: Sequence[FloatArray] = (),
    set_aside: Mapping[str, BoolArray] | None = None,
) -> tuple[Any, tuple[str, ...]]:
    """The sources to keep, and a note about the others; those `set_aside` are no error, whatever `on_bad` is."""
    if n == 0:
        raise EmptyFieldError("the catalogue is empty: there are no sources to use")
    # A row is counted once, for the first of its reasons.
    is_bad, reasons = np.zeros(n, bool), {**(set_aside or {}), **invalid}
    for reason, mask in reasons.items():
        reasons[reason] = mask & ~is_bad
        is_bad |= mask
    has_invalid = any(reasons[reason].any() for reason in invalid)
    row_masks = {reason: mask for reason, mask in reasons.items() if mask.any()}
    n_bad = int(is_bad.sum())
    if not n_bad:
        return slice(None), ()
    counts_by_reason = {reason: int(mask.sum()) for reason, mask in row_masks.items()}
    note = DroppedRows.of_table(counts_by_reason, n, np.packbits(is_bad), *identifying_arrays)
    if n_bad == n:
        error = EmptyFieldError(f"{_describe_unusable_rows(row_masks, n, first_row)}. No row is left")
        error.notes = (note,)
        raise error
    if on_bad == "raise" and has_invalid:
        invalid_masks = {reason: mask for reason, mask in row_masks.items() if reason not in (set_aside or {})}
        remedy = 'Fix them, or leave them out with on_bad="drop" (--on-bad drop)'
        raise FieldError(f"{_describe_unusable_rows(invalid_masks, n, first_row)}; rows are counted from 0. {remedy}")
    return ~is_bad, (note,)


def _describe_unusable_rows(masks, n, first_row):
    details = "; ".join(
        f"{reason}: {mask.sum()} ({_format_row_numbers(mask, first_row)})" for reason, mask in masks.items()
    )
    return f"{sum(mask.sum() for mask in masks.values())} of {n} rows cannot be used: {details}"


def _format_row_numbers(mask, first_row=0, limit=5):
    """The first rows of a mask, counted from 0."""
    rows = np.flatnonzero(mask)
    numbers = ", ".join(map(str, row_numbers(rows[:limit], first_row)))
    return f"row{'s' * (rows.size > 1)} {numbers}{', …' * (rows.size > limit)}"


def row_numbers(rows: Any, first_row: Any) -> Any:
    """Numbers in a whole table of rows of a block: which one it begins with, or that of each row."""
    return rows + first_row if np.ndim(first_row) == 0 else first_row[rows]


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|nan|", re.IGNORECASE)


def _parse_number_texts(column, array, first_row):
    """An array whose texts are numbers, with a minus or an exponent as they may be written; blank ones are nan."""
    parsed_values, texts = array.astype(object), {}
    for row, entry in enumerate(array.ravel()):
        if isinstance(entry, (str, bytes)):
            text = (entry.decode("utf-8", "replace") if isinstance(entry, bytes) else str(entry)).strip()
            number_text = text.replace("\u2212", "-")
            if _NUMBER.fullmatch(number_text):
                parsed_values.flat[row] = float(re.sub("[dD]", "e", number_text) or "nan")
            else:
                texts[row] = text
    if texts:
        (row, text), more = next(iter(texts.items())), f" and {len(texts) - 1} more" if len(texts) > 1 else ""
        quoted = one_line_text(text[:40])
        remedy = f"--where {shlex.quote(f'{column} != {quoted!r}')}" if len(set(texts.values())) == 1 else "a condition"
        row_number = row_numbers(np.array([row]), first_row)[0]
        raise FieldError(
            f"{column} holds text ({quoted!r} in row {row_number}, counted from 0{more}); it must "
            f"be a column of numbers: correct them, or leave them out by {remedy}"
        )
    return parsed_values


def check_distances_and_errors(noun: Any) -> None:
    """Raise FieldError where distances, or errors of redshifts, distances or parallaxes, cannot be used."""
    for column in ("redshift_error", "distance", "distance_error", "parallax_error"):
        values = getattr(noun, column)
        if values is None:
            continue
        limit = "zero or more" if column == "redshift_error" else "above zero"
        with np.errstate(invalid="ignore"):
            bad = (values < 0) | ((values == 0) & (limit != "zero or more")) | np.isinf(values)
        if bad.any():
            raise FieldError(f"{bad.sum()} values of {column} (first: row {bad.argmax()}) are not {limit}, nor missing")
    if noun.distance is not None:
        has_distance = np.isfinite(noun.distance)
        lacks_error = has_distance & ~np.isfinite(np.nan if noun.distance_error is None else noun.distance_error)
        if lacks_error.any():
            raise FieldError(
                f"{lacks_error.sum()} of {has_distance.sum()} distances have no errors "
                "(distance_error=, --columns distance_error=NAME): how far they are to be trusted is what they are "
                "worth"
            )
