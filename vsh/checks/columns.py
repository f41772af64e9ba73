"""From columns as catalogues have them to the arrays of a field: units, implausible values, rows that cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vsh.checks.types import ArrayLike, BoolArray, FloatArray, OnBad
from vsh.checks.validation import as_floats, check_shapes, invalid_rows, placeholders, select_usable
from vsh.errors import FieldError
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
    """The arrays of a field, without rows that cannot be used, and notes.

    Parameters
    ----------
    given : dict of str to array or None
        ra, dec [deg]; pmra, pmdec, their errors [mas/yr]; pmra_pmdec_corr, and what of `MEASURED` is known.
    name : (n,) array or None
        Names of the sources.
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used.
    first_row : int
        Number of the first row in messages.
    unusable : dict of str to mask, optional
        Further rows that cannot be used, by reason: the first that is said of them.

    Returns
    -------
    columns : dict of str to array
        lon, lat [rad], motion, sigma [µas/yr], rho, and what of `MEASURED`, and the name, is given.
    notes : tuple of str
        What was taken as missing, and which rows were left out.

    Raises
    ------
    FieldError
        If a column is no array of n numbers, or, with "raise", if any row cannot be used.
    """
    notes: tuple[str, ...] = ()
    if on_bad not in ("raise", "drop"):
        raise FieldError(f"on_bad is 'raise' or 'drop', not {on_bad!r}")
    units = dict.fromkeys(("ra", "dec"), "deg") | dict.fromkeys(_MOTIONS, "mas / yr")
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
    return kept, (*notes, *said)


def check_measured(noun: Any) -> None:
    """Raise FieldError where redshifts or distances of a field have no errors that can be used.

    Parameters
    ----------
    noun : Field
        What is checked.

    Raises
    ------
    FieldError
        If an error is negative, a distance not above zero, or without an error.
    """
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
    """The arrays of a field whose motions are zero.

    Parameters
    ----------
    sources : object with lon and lat [rad]
        And perhaps sigma, rho, redshift.
    sigma : float or (2, n) array, optional
        In place of its own. [µas/yr]

    Raises
    ------
    FieldError
        If there are no positions, or no errors.
    """
    if not (hasattr(sources, "lon") and hasattr(sources, "lat")):
        raise FieldError(f"sources are a Field, or positions with lon and lat, not {type(sources).__name__}")
    sigma = getattr(sources, "sigma", None) if sigma is None else sigma
    if sigma is None:
        raise FieldError("sources without errors need sigma=, in µas/yr")
    lon = np.asarray(sources.lon, float)
    shape = (2, lon.size)
    still = {"lon": lon, "lat": sources.lat, "motion": np.zeros(shape), "sigma": np.broadcast_to(sigma, shape)}
    return still | {name: getattr(sources, name, None) for name in ("rho", "redshift")}
