"""Units of columns, and columns as plain numbers and names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from astropy import units as u

from vsh.catalogue._columns import FURTHER_UNITS, GAIA, MUST_SAY, REQUIRED, UNITS, missing_column
from vsh.checks.notes import printable
from vsh.checks.types import BoolArray
from vsh.checks.validation import as_floats
from vsh.errors import TableError
from vsh.tables import TableSource


def factors(where: Mapping[str, str], units: Mapping[str, Any] | None, source: TableSource) -> Any:
    """By which each column of positions, motions and errors is multiplied, and notes on units that were assumed."""
    for name in units or {}:
        if name not in source.names:
            raise TableError(f"units: {missing_column(name, source)}")
    found, assumed = {}, {}
    for role in REQUIRED:
        if role not in where:
            continue
        name, wanted = where[role], UNITS[role]
        unit = (units or {}).get(name, source.units.get(name))
        if unit is None or str(unit).strip() == "":
            if name != getattr(GAIA, role):
                raise TableError(
                    f"column {name!r} has no unit: say which, units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
                )
            assumed.setdefault(str(wanted), []).append(name)
            unit = wanted
        found[role] = _factor(name, unit, wanted, name in (units or {}))
    for role in (each for each in FURTHER_UNITS if each in where):
        name, wanted = where[role], FURTHER_UNITS[role]
        unit = (units or {}).get(name, source.units.get(name))
        if unit is not None and str(unit).strip():
            found[role] = _further(role, name, unit, wanted, name in (units or {}))
        elif role in MUST_SAY:
            raise TableError(
                f"column {name!r} has no unit: say which, units={{{name!r}: {str(wanted)!r}}} (--units {name}={wanted})"
            )
    return found, assumed


def differing_units(where: Mapping[str, str], found: Mapping[str, Any]) -> list[str]:
    """A note where motions and their errors are not all in one unit, which is seldom meant."""
    sizes = {role: found[role] for role in ("pmra", "pmdec", "pmra_error", "pmdec_error") if role in found}
    if len({float(f"{size:.9g}") for size in sizes.values()}) < 2:
        return []
    listed = ", ".join(f"{printable(where[role])} in units of {size:.6g} mas/yr" for role, size in sizes.items())
    return [f"proper motions and errors are in different units: is that so? ({listed})"]


def parse_unit(unit: Any) -> Any:
    """A unit from what a table or a user says: in astropy's own spelling, that of FITS, VOTable or CDS."""
    if not isinstance(unit, str):
        return u.Unit(unit)
    for form in ("generic", "vounit", "cds", "ogip"):
        try:
            return u.Unit(unit, format=form)
        except (ValueError, TypeError):
            continue
    return u.Unit(unit)


def unit_factor(name: str, unit: Any, wanted: str) -> float:
    """By which a column in a unit is multiplied to be in another; 1 where it has none."""
    return 1.0 if unit is None or not str(unit).strip() else _factor(name, unit, u.Unit(wanted), False)


def _factor(name, unit, wanted, given):
    said = printable(unit)
    try:
        parsed = parse_unit(unit)
    except (ValueError, TypeError):
        place = "units" if given else "the table"
        raise TableError(
            f"{place}: {said!r}, given for {name}, is no unit that astropy knows: say what it is, "
            f"units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
        ) from None
    if not isinstance(parsed, u.UnitBase):
        raise TableError(f"column {name!r} is in {said!r}, a logarithm: turn it into a linear unit, {wanted} say")
    try:
        factor = float(parsed.to(wanted))
    except (u.UnitConversionError, ValueError, TypeError, AttributeError):
        raise TableError(
            f"column {name!r} is in {said!r}, which cannot be turned into {wanted}: "
            f"if the table is wrong, say what it is, units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
        ) from None
    if not 0 < factor < np.inf:
        raise TableError(f"column {name!r} is in {said!r}, a unit that is not positive: signs would turn")
    return factor


def _further(role, name, unit, wanted, given):
    """The factor of a column that need not be there: a pure number, a magnitude, a distance."""
    try:
        parsed = parse_unit(unit)
    except (ValueError, TypeError):
        if wanted == u.dimensionless_unscaled and not given:
            return 1.0  # words such as "none"
        return _factor(name, unit, wanted, given)  # which says what is wrong
    if role == "magnitude":  # of any zero point: magnitudes are told apart by their differences alone
        if parsed == u.dimensionless_unscaled or parsed == u.mag or isinstance(parsed, u.MagUnit):
            return 1.0
    elif role in ("redshift", "redshift_error"):
        if parsed != u.dimensionless_unscaled:
            raise TableError(
                f"column {name!r} is in {printable(unit)!r}, not a redshift: divide velocities by c, or say which column "
                f"has redshifts (--columns {role}=NAME)"
            )
        return 1.0
    return _factor(name, unit, wanted, given)


def plain(name: str, values: Any, missing: BoolArray | None) -> Any:
    """A column of numbers as a masked array of doubles."""
    floats, mask = as_floats(printable(name), np.ma.MaskedArray(values, False if missing is None else missing))
    return np.ma.MaskedArray(floats, mask)


def identifiers(name: str, values: Any, missing: BoolArray | None) -> Any:
    """Names as 64-bit integers or text, and notes; masked integers become text, so that no digit is lost."""
    said = []
    mask = np.zeros(len(values), bool) if missing is None else missing
    if values.dtype.kind == "f" and not mask.all():
        said.append(f"warning: {name} is a column of floating-point numbers, so long identifiers have lost digits")
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    if mask.any() or values.dtype.kind not in "iuU":
        values = np.where(mask, "", values.astype(str))
    elif values.dtype.kind in "iu":
        values = values.astype(values.dtype.newbyteorder("="))
    named = np.sort(
        values[values != ""] if values.dtype.kind == "U" else values
    )  # a sort is faster than np.unique's hash
    repeated = int(np.sum(named[1:] == named[:-1]))
    if repeated:
        said.append(f"warning: {repeated} rows repeat the {name} of another row and are used as separate sources")
    return values, said
