"""Units and names of the columns of a table: what a unit is, and which column may be meant where one is missing."""

import re
import shlex
from difflib import get_close_matches
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from astropy import units as u

from vsh.io.tables import TableSource
from vsh.tools.errors import TableError
from vsh.tools.printing import printable

#: Names of the columns that a field needs.
REQUIRED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
#: Before the names of columns that a table lacks, and that are made for it.
ASSUMED = "assumed "


def missing_column(name: str | None, source: TableSource) -> str:
    """Message on a column that is missing, with the nearest names."""
    names = [column for column in source.names if not column.startswith(ASSUMED)]
    nearest = [column for column in names if column.lower() == str(name).lower()]
    candidates = [column for column in names[:2000] if column.lower() not in REQUIRED]  # those are what they are called
    nearest = nearest or get_close_matches(str(name), candidates, n=3, cutoff=0.6)
    hint = f"; nearest: {', '.join(map(printable, nearest))}" if nearest else ""
    shown_names = list(map(printable, names[:200]))
    suffix = f" and {len(names) - 200} more" if len(names) > 200 else ""
    return f"no column {printable(name)!r}. The table has {', '.join(shown_names)}{suffix}{hint}{source.others}"


def parse_unit(unit: Any) -> Any:
    """A unit from what a table or a user says: in astropy's own spelling, that of FITS, VOTable or CDS."""
    return _parse_unit_text(unit) if isinstance(unit, str) else u.Unit(unit)


#: How units are written that astropy does not know so.
_UNIT_SPELLINGS = {
    "see description": "",
    "degrees": "deg", "degree": "deg", "hours": "hourangle", "milliarcsec": "mas", "microarcsec": "uas", "muas": "uas",
}  # fmt: skip
#: What units are written within, and spellings of a numerator and of a time.
_FRAMED = re.compile(r"\s*(?:angular velocity|angle|dimensionless)?\s*\[(.*)\]\s*", re.IGNORECASE)
_UNIT_REPLACEMENTS = (
    (re.compile(r"^(?:muas|micro-?arcsec)\b"), "uas"),
    (re.compile(r"^milli-?arcsec\b"), "mas"),
    (re.compile(r"/\s*(?:y|years?|yrs|a)$"), "/yr"),
    (re.compile(r"^(.*)/\s*(?:century|cy)$"), r"0.01 \1/yr"),
)
#: Sexagesimal text, which is made degrees as it is read.
_UNIT_SPELLINGS |= dict.fromkeys(("h:m:s", "d:m:s", '"h:m:s"', '"d:m:s"'), "deg")


@lru_cache(1000)
def _parse_unit_text(unit):
    unit = match[1] if (match := _FRAMED.fullmatch(unit)) else unit
    unit = _UNIT_SPELLINGS.get(unit.strip().lower(), unit)
    spelled = unit.strip().lower()
    for pattern, replacement in _UNIT_REPLACEMENTS:
        spelled = pattern.sub(replacement, spelled)
    for spelling, form in (*product((unit,), ("generic", "vounit", "cds", "ogip")), (spelled, "generic")):
        try:
            return u.Unit(spelling, format=form)
        except (ValueError, TypeError):
            continue
    return u.Unit(unit)


def unit_factor(name: str, unit: Any, wanted: str) -> float:
    """Factor from one unit to another; 1 where a column has none."""
    return 1.0 if unit is None or not str(unit).strip() else find_factor_to(name, unit, u.Unit(wanted), False)


def find_factor_to(name: str, unit: Any, target: Any, from_user: bool, alike: Any = ()) -> float:
    """Factor from the unit of a column to another; TableError with a remedy, for all columns `alike`, where none is."""
    place, remedy = f"column {name!r} is in {printable(unit)!r}", _ask_unit(alike or [name], target)
    try:
        astropy_unit = parse_unit(unit)
    except (ValueError, TypeError):
        origin = "units" if from_user else "the table"
        raise TableError(
            f"{origin}: {printable(unit)!r}, given for {name}, is no unit that astropy knows: {remedy}"
        ) from None
    if not isinstance(astropy_unit, u.UnitBase):
        raise TableError(f"{place}, a logarithm: turn it into a linear unit, {target} say")
    try:
        factor = float(astropy_unit.to(target))
    except (u.UnitConversionError, ValueError, TypeError, AttributeError):
        if astropy_unit.is_equivalent(u.Unit(target) ** 2):
            raise TableError(f"{place}, a variance: give its root") from None
        raise TableError(f"{place}, which cannot be turned into {target}: if the table is wrong, {remedy}") from None
    if not 0 < factor < np.inf:
        raise TableError(f"{place}, a negative unit: correct it, --units")
    return factor


def _ask_unit(names, target):
    """The option that says a unit. None is proposed: only the user knows in which unit the numbers are."""
    python_text, shell_text = (", ".join(f"{name!r}: …" for name in names), ",".join(f"{name}=…" for name in names))
    kinds = {u.deg: "deg, hourangle or rad", u.mas / u.yr: "uas/yr, mas/yr or arcsec/yr", u.Mpc: "kpc or Mpc"}
    return (
        f"say the unit of its numbers, units={{{python_text}}} (--units {shlex.quote(shell_text)}): "
        f"{kinds.get(target, f'{target} say')}"
    )
