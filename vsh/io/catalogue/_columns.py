"""Where a table keeps what a field needs, and in which units."""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
from astropy import units as u

from vsh.field import PLAUSIBLE_RANGES
from vsh.io import tables
from vsh.io.catalogue import _names
from vsh.io.catalogue._names import NAMED, ColumnRequest, Columns, find_correlation_columns, split_name_and_unit
from vsh.io.columns import ASSUMED, REQUIRED, find_factor_to, missing_column, parse_unit
from vsh.io.tables import TableSource
from vsh.sky.frames import MEASURED_KEY
from vsh.tools.bad_rows import as_floats_and_mask, is_within, span_of
from vsh.tools.errors import EmptySelectionError, FieldError, TableError
from vsh.tools.notes import (
    ASSUMED_MOTIONS,
    ASSUMED_UNITS,
    DOUBT,
    FALSE,
    MISSING,
    UNUSED_CORRELATIONS,
    CodedNote,
    UnselectedRows,
)
from vsh.tools.printing import printable
from vsh.tools.types import BoolArray
from vsh.tools.units import SPEED_OF_LIGHT

UNITS = dict.fromkeys(("ra", "dec"), u.deg) | dict.fromkeys(REQUIRED[2:], u.mas / u.yr)
#: Units in which a field has the columns that need not be there.
FURTHER_UNITS = {
    "pmra_pmdec_corr": u.dimensionless_unscaled, "magnitude": u.mag, "redshift": u.dimensionless_unscaled,
    "redshift_error": u.dimensionless_unscaled, "distance": u.Mpc, "distance_error": u.Mpc,
    "parallax": u.mas, "parallax_error": u.mas,
}  # fmt: skip
#: Those whose unit is asked for where a table does not tell it: nobody would see that kpc were taken as Mpc.
UNIT_REQUIRED = ("distance", "distance_error", "parallax", "parallax_error")


#: No distance is apart from that by the redshift, at H0 = 70 km/s/Mpc, by such a factor, for most sources.
_MAX_RATIO = 20.0


def as_columns(columns: Any) -> ColumnRequest:
    """Interpret a choice of columns: None (any known set of names), the name of a set, role to name, or Columns."""
    if columns is None:
        return ColumnRequest()
    if isinstance(columns, ColumnRequest):
        return columns
    if isinstance(columns, Columns):
        return ColumnRequest(columns, None)
    columns = {"names": columns} if isinstance(columns, str) else columns
    if not isinstance(columns, dict):
        raise TableError(
            f"columns are {', '.join(NAMED)}, a dict from role to name, or Columns, not {type(columns).__name__}"
        )
    set_name = columns.get("names", "gaia")
    if set_name not in NAMED:
        raise TableError(f"columns: no set of names is called {set_name!r}; there are {', '.join(NAMED)}")
    names = {role: name.strip() if isinstance(name, str) else name for role, name in columns.items() if role != "names"}
    roles = [f.name for f in fields(Columns)]
    unknown_roles = [str(role) for role in names if role not in roles]
    if unknown_roles:
        hint = "; frame= and redshift_frame= are arguments of their own" * ("frame" in " ".join(unknown_roles))
        raise TableError(f"columns: nothing is called {', '.join(unknown_roles)}; there are {', '.join(roles)}{hint}")
    return ColumnRequest(replace(NAMED[set_name], **names), None if "names" in columns else tuple(names))


def locate_columns(request: ColumnRequest, source: TableSource) -> tuple[dict[str, str], list[str]]:
    """Find the columns of a table that a field needs, and notes."""
    column_of, notes, absent = {}, [], []
    columns, set_name = request.choose_names(source.names)
    for f in fields(Columns):
        name = getattr(columns, f.name)
        if name is None and f.name not in REQUIRED:
            continue
        present = [candidate for candidate in _names.list_candidates(name) if candidate in source.names]
        if present:
            column_of[f.name] = present[0]
        elif name is None or isinstance(name, str):
            absent.append((f.name, name))
        elif f.name == "pmra_pmdec_corr":
            notes += _describe_missing_correlations(name, source, column_of.get("pmra"))
        elif f.name in ("solution", "quality"):
            notes += _describe_unused_flags(f.name, name, source)
    # What a field wrote of itself it reads: elsewhere a column called distance or parallax may be anything.
    for role in str(source.meta.get(MEASURED_KEY, "")).split():
        if role in UNIT_REQUIRED and role in source.names and role not in (request.asked_roles or ()):
            column_of.setdefault(role, role)
    if absent:
        (role, name), *remainder = absent
        remark = (
            f"; missing too: {', '.join(printable(missing_name) for _, missing_name in remainder)}" if remainder else ""
        )
        if all(re.fullmatch(r"col\d+", column) for column in source.names):
            remark += "; no line has as many names as there are values, so columns are called by their numbers"
        if {role for role, _ in absent} == {"pmra_error", "pmdec_error"}:
            sigma_effect = "gives all motions the same error in µas/yr"
            remark += f"; for a table without errors, sigma=100 (--columns sigma=100) {sigma_effect}"
        if set(REQUIRED[2:]) <= {role for role, _ in absent} and not {"ra", "dec"} & {role for role, _ in absent}:
            raise TableError(
                f"{source.label} is a list of positions, without motions ({missing_column(name, source)}): vsh-compare "
                "compares two of them, vsh-correlate needs one, vsh-sim --positions simulates motions; or say which "
                "columns are the motions: columns={'pmra': …} (--columns pmra=…,pmdec=…)"
            )
        best_columns, set_name = ColumnRequest().choose_names(source.names)
        is_known_set = set_name and all(getattr(best_columns, column) in source.names for column in REQUIRED)
        proposal = _propose_columns([role for role, _ in absent], column_of, source)
        answer = f"columns={set_name!r} (--columns {set_name})" if is_known_set else proposal
        raise TableError(f"{source.label}: {missing_column(name, source)}{remark}. Say which it is: {answer}")
    if twins := [name for name in column_of.values() if name in source.twins]:
        role = next(role for role, column in column_of.items() if column == twins[0])
        raise TableError(
            f"{source.label}: several columns are called {', '.join(map(repr, twins))}, and which is meant cannot be "
            f"told. Rename all but one, or name the second: --columns {shlex.quote(role)}="
            f"{shlex.quote(twins[0] + '_2')}"
        )
    if set_name:
        listing = ", ".join(f"{role} = {printable(column_of[role])}" for role in REQUIRED if role in column_of)
        notes.insert(0, f"columns by their names ({set_name}): {listing}")
    for name in dict.fromkeys(column_of.values()):
        roles = [role for role in REQUIRED if column_of.get(role) == name]
        if len(roles) > 1 and not name.startswith(ASSUMED):
            notes.append(f"column {printable(name)} is used for {' and '.join(roles)}")
    return column_of, notes


def _propose_columns(absent_roles, column_of, source):
    """The words that answer a question for columns: those of the likeliest names, and of units that nobody says."""
    guesses = _names.guess_missing_columns(column_of, source.names)
    proposed_names = {role: guesses.get(role, "…") for role in absent_roles}
    if "pmra" in absent_roles and "…" not in proposed_names.values():
        proposed_names |= dict(zip(("pmra_pmdec_corr",), find_correlation_columns(source), strict=False))
    all_names = column_of | proposed_names
    unitless = [all_names.get(role, "…") for role in REQUIRED[2:]]
    unitless = [name for name in unitless if name != "…" and find_column_unit(name, {}, source) is None]
    options = {"columns": proposed_names}
    if unitless and "…" not in proposed_names.values():
        options["units"] = dict.fromkeys(unitless, "mas/yr")
    python_text = ", ".join(f"{name}={mapping!r}" for name, mapping in options.items())
    words = {name: ",".join(f"{key}={value}" for key, value in mapping.items()) for name, mapping in options.items()}
    shell_text = " ".join(f"--{name} {shlex.quote(text)}" for name, text in words.items())
    return f"{python_text} ({shell_text})" + (", or another unit" if "units" in options else "")


def _describe_unused_flags(role, names, source):
    """Notes on columns of flags under other names than those that are looked for."""
    similar = [column for column in source.names if any(name in column.lower() for name in names)]
    text = f"warning: {', '.join(map(printable, similar))} is not used to leave out sources; "
    remedy = f"--columns {shlex.quote(f'{role}={printable(similar[0])}')}" if similar else ""
    return [CodedNote(f"{text}{remedy} uses it", DOUBT)] if similar else []


def _describe_missing_correlations(names, source, motion):
    """Notes on a table without correlations where they are looked for; those of other motions are not proposed."""
    correlations = find_correlation_columns(source)
    motions = [n for n in source.names if n not in correlations and not re.search("err|sig|unc|std|parallax|plx", n)]
    affixes = {_names.find_affixes(name, "pmra") for name in motions} - {_names.find_affixes(motion, "pmra"), ("", "")}
    similar = [name for name in correlations if not any(name.startswith(b) and name.endswith(a) for b, a in affixes)]
    if not similar:
        text = f"no column {' or '.join(dict.fromkeys(names))}: correlations taken as zero"
        return [CodedNote(text, ASSUMED_MOTIONS)]
    listing = ", ".join(map(printable, similar[:3]))
    text = (
        f"warning: correlations of the motions taken as zero, though the table has {listing}: if it is that, say "
        f"--columns {shlex.quote(f'pmra_pmdec_corr={printable(similar[0])}')}"
    )
    return [CodedNote(text, UNUSED_CORRELATIONS)]


#: From so many on the range of positions says something of their unit.
_ENOUGH_PLACES = 20


def check_position_unit(columns: Any, assumed: bool | None, names: Mapping[str, str] | None = None) -> list[CodedNote]:
    """Raise FieldError where bare positions look like radians or hours; a doubt about hours where a table has a unit.

    `assumed` is None where the user says the unit.
    """
    if assumed is None:
        return []
    ra = np.ma.compressed(np.ma.masked_invalid(columns["ra"]))
    if ra.size < _ENOUGH_PLACES or ra.max() > 24:  # as of nearly every block
        return []
    dec = np.ma.compressed(np.ma.masked_invalid(columns["dec"]))
    if dec.size < _ENOUGH_PLACES:
        return []
    lon, lat = (printable((names or {}).get(role, role)) for role in ("ra", "dec"))
    with np.errstate(invalid="ignore"):
        looks_like_radians = (ra >= -np.pi).all() and (ra <= 2 * np.pi).all() and (np.abs(dec) <= np.pi / 2).all()
        looks_like_hours = (ra >= 0).all() and (ra <= 24).all() and np.ptp(ra) > 12 and np.ptp(dec) > 30
    ranges = f"{ra.min():.3g} to {ra.max():.3g} and from {dec.min():.3g} to {dec.max():.3g}"
    if not assumed:
        text = f"warning: {lon} and {lat} reach from {ranges} as their unit says: is {lon} in hours (units=, --units)?"
        return [CodedNote(text, DOUBT)] if looks_like_hours else []
    if looks_like_radians and np.ptp(ra) > 1 and np.ptp(dec) > 0.5:
        raise FieldError(
            f"{lon} and {lat} have no unit and reach only from {ranges}: radians? Say units={{{lon!r}: 'rad', {lat!r}: "
            f"'rad'}} (--units {shlex.quote(f'{lon}=rad,{lat}=rad')}), or deg if they are degrees"
        )
    if looks_like_hours:
        raise FieldError(
            f"{lon} and {lat} have no unit and reach from {ranges}: is {lon} in hours? Say units={{{lon!r}: "
            f"'hourangle'}} (--units {shlex.quote(f'{lon}=hourangle')}), or deg if they are degrees"
        )
    return []


#: Median errors outside these are of no survey, nor is a median motion above the last. [µas/yr]
_PLAUSIBLE_ERRORS = 1.0, 1e5
_MAX_MOTION = 3e6
#: Motions below this share of the smallest error are in another unit: of twenty sources not one would be so small.
_SMALL_SHARE = 0.1


def describe_odd_values(field: Any, min_sources: int = 20, *, is_unit_assumed: bool = False) -> list[str]:
    """Warnings of numbers that no survey has, with the likely cause; nothing is changed.

    Where the unit of motions is assumed, smaller numbers are doubted already.
    """
    error_limits = _PLAUSIBLE_ERRORS[0], _PLAUSIBLE_ERRORS[1] / (2 if is_unit_assumed else 1)
    sigma, motion = field.sigma, field.motion
    if len(field) < min_sources or (motion == 0).all():
        return []
    # Where all are plausible their medians are, which take longer to see.
    (least, most), (lowest, highest) = span_of(sigma), span_of(motion)
    is_plausible = is_within((least, most), *error_limits) and is_within((lowest, highest), -_MAX_MOTION, _MAX_MOTION)
    notes = [] if is_plausible else _describe_odd_medians(np.median(sigma), np.median(np.abs(motion)), error_limits)
    if max(-lowest, highest) < _SMALL_SHARE * least:
        text = f"no motion is above {max(-lowest, highest):.3g} µas/yr, and no error below {least:.3g} µas/yr"
        notes.append(CodedNote(f"warning: {text}: in which units are they (units=, --units)?", DOUBT))
    notes += [] if field.redshift is None else _describe_repeated_redshifts(field.redshift)
    if field.redshift is not None and field.distance is not None:
        notes += _describe_odd_distances(field.distance, field.redshift)
    return notes


#: Redshifts of one value are many where they are more, and more than so many times those of the next.
_MANY_SAME, _SAME_FACTOR = 20, 5


def _describe_repeated_redshifts(redshift):
    """A warning where many redshifts have one value, as marks of missing ones do."""
    values, counts = np.unique(redshift[np.isfinite(redshift)], return_counts=True)
    values, counts = values[1:], counts[1:]  # the smallest may be a limit of the sample
    if len(counts) < 2 or (most := int(counts.max())) <= max(_MANY_SAME, _SAME_FACTOR * np.sort(counts)[-2]):
        return []
    text = f"{most} redshifts are exactly {values[counts.argmax()]:g}: a mark of missing ones? They are used"
    return [CodedNote(f"warning: {text}", DOUBT)]


def _describe_odd_distances(distance, redshift):
    """A warning where distances and redshifts are apart by a power of ten or more, as kpc and Mpc are."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = distance * 70 / (SPEED_OF_LIGHT * np.where(redshift > 0.002, redshift, np.nan))
    median_ratio = np.median(ratio[np.isfinite(ratio)]) if np.isfinite(ratio).sum() > 9 else 1.0
    if 1 / _MAX_RATIO < median_ratio < _MAX_RATIO:
        return []
    text = f"distances are {median_ratio:.2g} times those by the redshifts: is their unit right (--units distance=…)?"
    return [CodedNote(f"warning: {text}", DOUBT)]


def _describe_odd_medians(median_error, median_abs_motion, error_limits):
    """Warnings of a median error and a median motion in µas/yr."""
    notes = []
    if not error_limits[0] < median_error < error_limits[1]:
        side, cause = ("above", "µas/yr read as mas/yr") if median_error > 1 else ("below", "mas/yr read as µas/yr")
        text = f"{side} {median_error:.3g} µas/yr, which no survey has: {cause}? Say the unit: units= (--units)"
        notes.append(CodedNote(f"warning: half of the errors are {text}", DOUBT))
    if median_abs_motion > 300 * max(median_error, 1.0) and median_abs_motion > _MAX_MOTION:
        text = f"above {median_abs_motion:.3g} µas/yr: is the unit right (units=, --units)?"
        notes.append(CodedNote(f"warning: half of the motions are {text}", DOUBT))
    return notes


class RowSelection:
    """A condition on one table."""

    def __init__(self, where: str, source: TableSource, roles: Any = None, units: Any = None) -> None:
        self._where, roles = tables.Where(where), dict(roles or {})
        # A role stands for the column that has it, where no column is called so: redshift for redshift_qsoc.
        absent = [name for name in self._where.names if name not in source.names]
        self._roles = {role: column for role, column in roles.items() if role in absent}
        self._where.check((*source.names, *self._roles), source.label)
        self.names = tuple(dict.fromkeys(self._roles.get(name, name) for name in self._where.names))
        # Beyond these a number marks a missing value, as it does in a field: 99 of redshifts, 999 of magnitudes.
        self._ranges = {
            column: PLAUSIBLE_RANGES[role]
            for role in ("magnitude", "redshift")
            if (column := roles.get(role)) in self.names
            and (role == "magnitude" or str(find_column_unit(column, units or {}, source) or "1") == "1")
        }

    def select_rows(self, block: Mapping[str, Any], first_row: int) -> tuple[dict[str, Any], Any, list[str]]:
        """The selected rows of a block, their numbers, and a note that counts the others."""
        remarks = []
        for column, (low, high) in self._ranges.items():
            values, mask = block[column]
            if values.dtype.kind in "fiu":
                is_known = (values > low) & (values < high)
                block = {**block, column: (values, ~is_known if mask is None else ~is_known | mask)}
                remarks += [f"{printable(column)} beyond {low:g} … {high:g} counts as missing"] * (not is_known.all())
        condition_columns = {name: block[self._roles.get(name, name)] for name in self._where.names}
        selection, missing = self._where.select_rows(condition_columns or block)
        counts = {FALSE: int((~selection & ~missing).sum()), MISSING: int(missing.sum())}
        counts = {reason: count for reason, count in counts.items() if count}
        fingerprint = np.packbits(selection), np.array([first_row]), *(array for array, _ in list(block.values())[:2])
        note = UnselectedRows.of_table(counts, len(selection), *fingerprint, names=(self._where.shown,))
        if not selection.any():
            raise make_empty_selection_error((note,), remarks)
        rows = np.flatnonzero(selection)
        return tables.take_rows(block, rows), first_row + rows, [note]


def make_empty_selection_error(notes: Sequence[str], remarks: Sequence[str] = ()) -> EmptySelectionError:
    """The error of a table without a selected row."""
    error = EmptySelectionError("no row is left by --where: " + "; ".join(map(str, (*notes, *remarks))))
    error.notes = tuple(notes)
    return error


def find_conversion_factors(
    column_of: Mapping[str, str], units: Mapping[str, Any] | None, source: TableSource, assumed_unit: str | None = None
) -> Any:
    """Factors on the columns by role, and the names of the columns that were taken in an assumed unit, by unit."""
    units = {str(name).strip(): unit for name, unit in (units or {}).items()}
    for name in units:
        if name not in source.names:
            raise TableError(f"units: {missing_column(name, source)}")
    role_factors: dict[str, Any] = {}
    assumed_units: dict[str, list[str]] = {}
    missing_units: dict[str, str] = {}
    # Motions and errors without a unit are all in that of pmra.
    gaia_like_roles = REQUIRED[3:] if column_of.get("pmra", "").lower() == "pmra" else ()
    for role in [role for role in (*REQUIRED, *FURTHER_UNITS) if role in column_of]:
        name, target_unit = column_of[role], UNITS.get(role, FURTHER_UNITS.get(role))
        unit = find_column_unit(name, units, source)
        if role == "ra" and str(unit).strip().lower() in ("h", "hr", "hour", "hours"):
            unit = "hourangle"
        if unit is not None:
            columns = [column_of[other] for other in REQUIRED[2:] if other in column_of and role in REQUIRED[2:]]
            alike = [column for column in columns if find_column_unit(column, units, source) == unit]
            role_factors[role] = _find_role_factor(role, name, unit, target_unit, name in units, alike)
        elif role in _UNIT_OF and (unit := find_column_unit(column_of[_UNIT_OF[role]], units, source)) is not None:
            # An error is in the unit of what it is the error of, unless the table states another.
            motion_name = column_of[_UNIT_OF[role]]
            assumed_units.setdefault(f"{_format_unit(unit)}, the unit of {printable(motion_name)}", []).append(name)
            role_factors[role] = find_factor_to(motion_name, unit, target_unit, motion_name in units)
        elif assumed_unit is not None and role in REQUIRED[2:]:
            assumed_units.setdefault(assumed_unit, []).append(name)
            role_factors[role] = find_factor_to(name, assumed_unit, target_unit, False)
        elif role in ("ra", "dec") or (role in _GAIA_UNITS and name.lower() == role) or role in gaia_like_roles:
            assumed_units.setdefault(_format_unit(target_unit), []).append(name)
            role_factors[role] = 1.0
        elif role in REQUIRED or role in UNIT_REQUIRED:
            is_modulus = role.startswith("distance") and _OF_MODULI.search(name)
            missing_units[name] = "mag" if is_modulus else _format_unit(target_unit)
    if missing_units:
        names = ", ".join(map(repr, missing_units))
        subject = f"columns {names} have" if len(missing_units) > 1 else f"column {names} has"
        hint = shlex.quote(",".join(f"{name}={unit.replace(' ', '')}" for name, unit in missing_units.items()))
        is_length = any(column_of.get(role) in missing_units for role in ("distance", "distance_error"))
        length_units = ", or kpc, pc, or mag of distance moduli" if is_length else ""
        raise TableError(f"{subject} no unit: say which, units={missing_units!r}{length_units} (--units {hint})")
    return role_factors, assumed_units


#: Names of distance moduli and of their errors.
_OF_MODULI = re.compile(r"(^|_)(mu\d?|dm|dmod|mod|modulus|moduli)(_|$)|dist\w*mod", re.IGNORECASE)
#: The motions whose units their errors have.
_UNIT_OF = {"pmra_error": "pmra", "pmdec_error": "pmdec"}
#: Columns that are taken in Gaia's units where they have its names and no unit; positions are in any case.
_GAIA_UNITS = (*REQUIRED, "parallax", "parallax_error")


def find_column_unit(name: str, units: Mapping[str, Any], source: TableSource) -> Any:
    """The unit of a column: the user's, the table's, or that in its name; None where nobody says it."""
    for unit in (units.get(name), source.units.get(name), split_name_and_unit(name)[1]):
        if unit is not None and str(unit).strip():
            return unit
    return None


@lru_cache
def _format_unit(unit):
    return str(unit)


def describe_mixed_units(column_of: Mapping[str, str], factors: Mapping[str, Any]) -> list[str]:
    """A note where motions and their errors are not all in one unit, which is seldom meant."""
    roles = [role for role in REQUIRED[2:] if role in factors]
    scales = {role: factors[role] for role in roles if not column_of[role].startswith(ASSUMED)}
    if len({float(f"{size:.9g}") for size in scales.values()}) < 2:
        return []
    listing = ", ".join(f"{printable(column_of[role])} in units of {size:.6g} mas/yr" for role, size in scales.items())
    return [CodedNote(f"proper motions and errors are in different units: is that so? ({listing})", ASSUMED_UNITS)]


def _find_role_factor(role, name, unit, target, from_user, alike):
    """The factor of a column that may be a pure number, a magnitude or a distance."""
    try:
        astropy_unit = parse_unit(unit)
    except (ValueError, TypeError):
        if target == u.dimensionless_unscaled and str(unit).strip().lower() in _WORDS_FOR_NO_UNIT:
            return 1.0
        return find_factor_to(name, unit, target, from_user, alike)  # which says what is wrong
    if role == "magnitude":  # of any zero point: magnitudes are separated by their differences alone
        if astropy_unit == u.dimensionless_unscaled or astropy_unit == u.mag or isinstance(astropy_unit, u.MagUnit):
            return 1.0
    elif role in ("redshift", "redshift_error"):
        if astropy_unit == u.dimensionless_unscaled or (from_user and astropy_unit == u.percent):
            return float(astropy_unit.to(u.dimensionless_unscaled))
        if from_user and astropy_unit.is_equivalent(u.km / u.s):  # asked for: c z
            return float(astropy_unit.to(u.km / u.s)) / SPEED_OF_LIGHT
        raise TableError(
            f"column {name!r} is in {printable(unit)!r}, not a redshift: if it is c z, say so, --units "
            f"{shlex.quote(f'{name}=km/s')}; or say which column has redshifts (--columns {role}=NAME)"
        )
    elif role in ("distance", "distance_error"):
        if astropy_unit == u.mag or isinstance(astropy_unit, u.MagUnit):
            if from_user:
                return MODULUS
            raise TableError(
                f"column {name!r} is in {printable(unit)!r}, not a length: if it is a distance modulus, say so, "
                f"--units {shlex.quote(f'{name}=mag')}"
            )
        if astropy_unit.is_equivalent(u.mas):
            raise TableError(
                f"column {name!r} is in {printable(unit)!r}, which cannot be turned into Mpc: if it is a parallax, say "
                f"so, --columns {shlex.quote(f'parallax={name}')},parallax_error=NAME"
            )
    return find_factor_to(name, unit, target, from_user, alike)


#: Words that tables have where there is no unit.
_WORDS_FOR_NO_UNIT = ("none", "-", "--", "---", "unitless", "dimensionless", "null", "n/a")
#: In place of a factor: a distance modulus with its error, both in mag.
MODULUS = -1.0


def convert_moduli_to_distances(columns: dict[str, Any]) -> list[str]:
    """Transverse distances [Mpc] and their errors in place of distance moduli [mag], which are of luminosity; notes."""
    distance = 10 ** ((columns["distance"] - 25) / 5)
    notes = []
    if "redshift" in columns:
        z = np.ma.filled(np.ma.asarray(columns["redshift"], float), np.nan)
        has_redshift = np.isfinite(z) & (z > 0)
        distance = distance / (1 + np.where(has_redshift, z, 0.0))
        n_left = int(has_redshift.size - has_redshift.sum())
    else:
        n_left = np.size(distance)
    if n_left:
        notes = [f"{n_left} luminosity distances by their moduli are not divided by 1 + z, where no redshift is read"]
    columns["distance"] = distance
    if "distance_error" in columns:
        columns["distance_error"] = np.log(10) / 5 * columns["distance"] * columns["distance_error"]
    return notes


_SEXAGESIMAL = re.compile(r"\s*([-+]?)(\d+)[\s:hd°]+(\d+)[\s:m']+(\d+(?:\.\d*)?)[s\"]?\s*")


def parse_sexagesimal(role: str, name: str, values: Any, missing: BoolArray | None, unit: str = "") -> Any:
    """Degrees of positions that are text in hours or degrees, minutes and seconds; None of other columns.

    Right ascension is in hours unless its text has a mark of degrees, or its unit is one of degrees.

    Raises
    ------
    FieldError
        If right ascensions without such a unit go beyond 24 hours.
    """
    if role not in ("ra", "dec") or getattr(values, "dtype", np.dtype(float)).kind not in "US":
        return None
    text = values.astype(str)
    is_missing = np.zeros(len(text), bool) if missing is None else missing
    matches = [None if gone else _SEXAGESIMAL.fullmatch(entry) for entry, gone in zip(text, is_missing, strict=True)]
    is_wrong = np.array([match is None and not gone for match, gone in zip(matches, is_missing, strict=True)], bool)
    if 2 * is_wrong.sum() >= len(is_wrong):
        return None  # what is wrong with it is said where it is made numbers
    components = np.array([[0, 0, 0] if match is None else match.groups()[1:] for match in matches], float).T
    absolute = components[0] + components[1] / 60 + components[2] / 3600
    is_negative = np.array([match is not None and match[1] == "-" for match in matches])
    in_degrees = role == "dec" or unit.strip('"').lower() in ("d:m:s", "deg", "degree", "degrees")
    is_degree = np.array([in_degrees or "d" in entry or "°" in entry for entry in text])
    beyond = (absolute >= 24) & ~is_degree & ~is_wrong & ~is_missing
    if 10 * beyond.sum() > len(text):
        raise FieldError(
            f"column {name!r} goes beyond 24 hours in {beyond.sum()} of {len(text)} rows, {printable(text[beyond][0])} "
            f"say: degrees, minutes and seconds? Say units={{{name!r}: 'deg'}} (--units {shlex.quote(f'{name}=deg')})"
        )
    return np.where(is_wrong, np.nan, np.where(is_negative, -absolute, absolute) * np.where(is_degree, 1.0, 15.0))


def as_doubles(name: str, values: Any, missing: BoolArray | None, first_row: Any = 0) -> Any:
    """A column of numbers as an array of doubles, masked where values are missing."""
    if missing is None and not np.ma.isMaskedArray(values):
        return as_floats_and_mask(printable(name), values, None, first_row)[0]
    masked = np.ma.MaskedArray(values, False if missing is None else missing)
    floats, mask = as_floats_and_mask(printable(name), masked, None, first_row)
    return np.ma.MaskedArray(floats, mask)


def convert_identifiers(name: str, values: Any, missing: BoolArray | None) -> Any:
    """Names as 64-bit integers or text, and notes; masked integers become text, so that no digit is lost."""
    notes = []
    mask = np.zeros(len(values), bool) if missing is None else missing
    if values.dtype.kind == "f" and not mask.all():
        text = "is a column of floating-point numbers, so long identifiers have lost digits"
        notes.append(CodedNote(f"warning: {name} {text}", DOUBT))
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    if mask.any() or values.dtype.kind not in "iuU":
        values = np.where(mask, "", values.astype(str))
    elif values.dtype.kind in "iu":
        values = values.astype(values.dtype.newbyteorder("="))
    # A sort is faster than np.unique's hash.
    sorted_names = np.sort(values[values != ""] if values.dtype.kind == "U" else values)
    n_repeats = int(np.sum(sorted_names[1:] == sorted_names[:-1]))
    if n_repeats:
        text = f"{n_repeats} rows repeat the {name} of another row: a fit uses each, matching leaves them out"
        notes.append(CodedNote(f"warning: {text}", DOUBT))
    return values, notes
