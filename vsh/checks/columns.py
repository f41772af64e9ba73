"""From columns as catalogues have them to the arrays of a field, and back: units, implausible values, rows that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vsh.checks.notes import merge_notes
from vsh.checks.types import ArrayLike, BoolArray, FloatArray, OnBad
from vsh.checks.validation import as_floats, check_shapes, doubtful, invalid_rows, placeholders, select_usable
from vsh.errors import FieldError, FrameError
from vsh.sky.frames import FRAME_KEY, FRAMES
from vsh.sky.redshift_frames import REDSHIFT_FRAME_KEY
from vsh.units import DEGREE, MAS

#: Beyond these a number stands for a missing value, or is none.
_PLAUSIBLE = {"redshift": (-1.0, 1100.0), "magnitude": (-30.0, 50.0), "redshift_error": (-1e-300, 100.0),
              "distance": (0.0, 1e6), "distance_error": (0.0, 1e6)}  # fmt: skip
#: What of a source may be known besides its motion.
MEASURED = ("redshift", "magnitude", "redshift_error", "distance", "distance_error")
_MOTIONS = ("pmra", "pmdec", "pmra_error", "pmdec_error")


def usable_columns(
    given: Mapping[str, Any],
    name: ArrayLike | None,
    on_bad: OnBad,
    first_row: int,
    unusable: Mapping[str, BoolArray] | None = None,
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The arrays of a field, without rows that cannot be used, and notes."""
    notes: tuple[str, ...] = ()
    if on_bad not in ("raise", "drop"):
        raise FieldError(f"on_bad is 'raise' or 'drop', not {on_bad!r}")
    units = dict.fromkeys(("ra", "dec"), "deg") | dict.fromkeys(_MOTIONS, "mas / yr") | {"magnitude": "mag"}
    units |= dict.fromkeys(("distance", "distance_error"), "Mpc")
    absent = [c for c in ("ra", "dec", *_MOTIONS) if given[c] is None]
    if absent:
        raise FieldError(f"{', '.join(absent)} must be given")
    pairs = {c: as_floats(c, v, units.get(c, "")) for c, v in given.items() if v is not None}
    columns, missing = ({c: pair[i] for c, pair in pairs.items()} for i in (0, 1))
    columns.setdefault("pmra_pmdec_corr", np.zeros(columns["ra"].shape))
    n = columns["ra"].size
    if name is not None:
        columns["name"] = np.asarray(name)
    check_shapes(columns, lambda column: (n,))

    lon, lat = columns["ra"] * DEGREE, columns["dec"] * DEGREE
    motion = MAS * np.stack([columns["pmra"], columns["pmdec"]])
    sigma = MAS * np.stack([columns["pmra_error"], columns["pmdec_error"]])
    rho = columns["pmra_pmdec_corr"]
    for column, (low, high) in _PLAUSIBLE.items():
        if column in columns:
            values = np.where(missing[column], np.nan, columns[column])
            odd = np.isfinite(values) & ~((values > low) & (values < high))
            if odd.any():
                notes = (*notes, f"{odd.sum()} values of {column} beyond {low:g} … {high:g} taken as missing")
            columns[column] = np.where(odd | np.isinf(values), np.nan, values)
    found = invalid_rows(
        lon, lat, motion, sigma, rho, dict(unusable or {}) | {f"{c} missing": mask for c, mask in missing.items()
        if c not in MEASURED}, placeholders({c: columns[c] for c in _MOTIONS}), turns=1
    )  # fmt: skip
    keep, said = select_usable(found, n, on_bad, first_row, (lon, lat))
    kept = {"lon": lon[keep], "lat": lat[keep], "motion": motion[:, keep], "sigma": sigma[:, keep], "rho": rho[keep]}
    kept |= {c: columns[c][keep] for c in (*MEASURED, "name") if c in columns}
    return kept, (*notes, *doubtful({c: columns[c][keep] for c in ("pmra", "pmdec")}), *said)


def check_measured(noun: Any) -> None:
    """Raise FieldError where redshifts or distances of a field have no errors that can be used."""
    for column, least in (
        ("redshift_error", "zero or more"),
        ("distance", "above zero"),
        ("distance_error", "above zero"),
    ):
        values = getattr(noun, column)
        if values is None:
            continue
        with np.errstate(invalid="ignore"):
            bad = (values < 0) | ((values == 0) & (least != "zero or more")) | np.isinf(values)
        if bad.any():
            raise FieldError(f"{bad.sum()} values of {column} (first: row {bad.argmax()}) are not {least}, nor missing")
    if noun.distance is not None:
        known = np.isfinite(noun.distance)
        sure = np.zeros(known.shape, bool) if noun.distance_error is None else np.isfinite(noun.distance_error)
        if (known & ~sure).any():
            raise FieldError(
                f"{(known & ~sure).sum()} of {known.sum()} distances have no errors (distance_error=, --columns distance_error=NAME): "
                "how far they are to be trusted is what they are worth"
            )


def still_columns(sources: Any, sigma: ArrayLike | None) -> dict[str, Any]:
    """The arrays of a field whose motions are zero."""
    if not (hasattr(sources, "lon") and hasattr(sources, "lat")):
        raise FieldError(f"sources are a Field, or positions with lon and lat, not {type(sources).__name__}")
    sigma = getattr(sources, "sigma", None) if sigma is None else sigma
    if sigma is None:
        raise FieldError("sources without errors need sigma=, in µas/yr")
    lon = np.asarray(sources.lon, float)
    shape = (2, lon.size)
    still = {"lon": lon, "lat": sources.lat, "motion": np.zeros(shape), "sigma": np.broadcast_to(sigma, shape)}
    return still | {name: getattr(sources, name, None) for name in ("rho", "redshift")}


def skycoord_columns(coord: Any) -> tuple[dict[str, Any], str]:
    """Positions and motions of an astropy SkyCoord as `from_columns` takes them, and the frame."""
    frame = getattr(coord, "frame", None)
    if frame is None or not hasattr(coord, "spherical"):
        raise FieldError(f"a SkyCoord is wanted, not {type(coord).__name__}")
    known = {theirs: ours for ours, theirs in FRAMES.items()}
    if frame.name not in known:
        raise FrameError(f"coordinates in {frame.name} are no field: take {', '.join(known)}, coord.icrs say")
    if "s" not in frame.data.differentials:
        raise FieldError("the SkyCoord has no proper motions: give it pm_ra_cosdec and pm_dec")
    seen, moves = coord.spherical, coord.sphericalcoslat.differentials["s"]
    found = {"ra": seen.lon, "dec": seen.lat, "pmra": moves.d_lon_coslat, "pmdec": moves.d_lat}
    return {name: np.ravel(values) for name, values in found.items()}, known[frame.name]


def table_columns(field: Any) -> tuple[dict[str, Any], dict[str, str], dict[str, Any]]:
    """A field in Gaia's names: columns, their units, and plain facts."""
    columns = {"source_id": np.arange(1, len(field) + 1) if field.name is None else field.name}
    columns |= {"ra": np.degrees(field.lon), "dec": np.degrees(field.lat)}
    columns |= {"pmra": field.motion[0] / MAS, "pmdec": field.motion[1] / MAS}
    columns |= {"pmra_error": field.sigma[0] / MAS, "pmdec_error": field.sigma[1] / MAS, "pmra_pmdec_corr": field.rho}
    optional = {"phot_g_mean_mag" if role == "magnitude" else role: getattr(field, role) for role in MEASURED}
    columns |= {name: values for name, values in optional.items() if values is not None}
    facts = {} if field.frame == "icrs" else {FRAME_KEY: field.frame}
    if field.redshift is not None and field.redshift_frame is not None:
        facts[REDSHIFT_FRAME_KEY] = field.redshift_frame
    units = dict.fromkeys(("ra", "dec"), "deg") | dict.fromkeys(_MOTIONS, "mas / yr") | {"phot_g_mean_mag": "mag"}
    units |= dict.fromkeys(("distance", "distance_error"), "Mpc")
    return columns, {name: unit for name, unit in units.items() if name in columns}, facts


def joined(one: Any, other: Any) -> dict[str, Any]:
    """The attributes of a field with the sources of two, one after the other; what one does not know of its sources is missing."""
    if other.frame != one.frame:
        raise FrameError(f"the fields are in {one.frame} and {other.frame}: take both to one frame")
    frames = {each.redshift_frame for each in (one, other) if each.redshift is not None}
    if len(frames) > 1:
        raise FieldError(f"redshifts stand in {' and '.join(map(str, frames))}: take them to one frame first")
    names = ("lon", "lat", "motion", "sigma", "rho", *MEASURED, "name")
    columns = {name: _both(one, other, name) for name in names}
    return columns | {"redshift_frame": next(iter(frames), None), "notes": merge_notes(one.notes, other.notes)}


def _both(one, other, name):
    """A column of two fields; NaN, or no name, for the sources of which it is not known."""
    columns = [getattr(each, name) for each in (one, other)]
    if all(column is None for column in columns):
        return None
    if name == "name" and len({None if column is None else column.dtype.kind for column in columns}) > 1:
        columns = [
            np.full(len(each), "") if column is None else column.astype(str)
            for each, column in zip((one, other), columns)
        ]
    columns = [np.full(len(each), np.nan) if column is None else column for each, column in zip((one, other), columns)]
    return np.concatenate(columns, axis=-1)
