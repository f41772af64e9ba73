"""Where a table keeps what a field needs, and in which units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from functools import lru_cache
from typing import Any

import numpy as np
from astropy import units as u

from vsh.io import tables
from vsh.io.archive import DR3, DR4
from vsh.io.tables import TableSource
from vsh.sky.frames import FRAME_KEY, FRAMES, REDSHIFT_FRAME_KEY, REDSHIFT_FRAME_NAMES, check_frame, redshift_frame_in
from vsh.tools.bad_rows import as_floats
from vsh.tools.errors import FieldError, NothingSelectedError, TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.notes import FALSE, MISSING, NotSelected, printable
from vsh.tools.types import BoolArray


@dataclass(frozen=True)
class Columns(InNotebook):
    """Where a table keeps what a field needs: a new survey is a new value of this.

    The first six must be there. The others may be left out with None; of several names in
    a tuple the first that the table has is taken, and none need be there. Where there is a `solution`, sources
    whose astrometry is not that of a single source with a parallax (31 or 95, `vsh.io.archive.DR4`) cannot be used.

    Examples
    --------
    >>> Columns(pmra="mu_ra", pmdec="mu_dec").pmra
    'mu_ra'
    """

    ra: str = "ra"
    dec: str = "dec"
    pmra: str = "pmra"
    pmdec: str = "pmdec"
    pmra_error: str = "pmra_error"
    pmdec_error: str = "pmdec_error"
    pmra_pmdec_corr: str | tuple | None = ("pmra_pmdec_corr",)
    name: str | tuple | None = ("source_id", "name", "designation")
    magnitude: str | tuple | None = ("phot_g_mean_mag",)
    redshift: str | tuple | None = ("redshift", "z", "redshift_qsoc")
    redshift_error: str | tuple | None = ("redshift_error", "z_error", "e_z")
    distance: str | tuple | None = None
    distance_error: str | tuple | None = None
    solution: str | tuple | None = (DR4.solution, DR3.solution)


#: Gaia's archive names.
GAIA = Columns()
#: Sets of names that are called by one: the archive's, those of VizieR's tables of Gaia (I/355/gaiadr3,
#: I/350/gaiaedr3), and those that the IERS's lists of ICRF2 and ICRF3 are given, where they are read as tables.
NAMED = {
    "gaia": GAIA,
    "vizier": Columns(
        ra="RA_ICRS", dec="DE_ICRS", pmra="pmRA", pmdec="pmDE", pmra_error="e_pmRA", pmdec_error="e_pmDE",
        pmra_pmdec_corr=("pmRApmDEcor",), name=("Source", "ID", "Name"), magnitude=("Gmag",),
        redshift=("z", "zsp", "Redshift"), redshift_error=("e_z", "e_zsp"), solution=("Solved",),
    ),
    "icrf": replace(GAIA, name=("iers", "icrf")),
}  # fmt: skip
REQUIRED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
UNITS = dict.fromkeys(("ra", "dec"), u.deg) | dict.fromkeys(REQUIRED[2:], u.mas / u.yr)
#: Units in which a field has the columns that need not be there.
FURTHER_UNITS = {
    "pmra_pmdec_corr": u.dimensionless_unscaled, "magnitude": u.mag, "redshift": u.dimensionless_unscaled,
    "redshift_error": u.dimensionless_unscaled, "distance": u.Mpc, "distance_error": u.Mpc,
}  # fmt: skip
#: Those whose unit is asked for where a table does not tell it: nobody would see that kpc were taken for Mpc.
MUST_SAY = ("distance", "distance_error")
#: Names that positions have in other frames than the equatorial one.
_OTHER_FRAMES = dict.fromkeys(("l", "b", "glon", "glat", "gal_lon", "gal_lat"), "galactic")
_OTHER_FRAMES |= dict.fromkeys(("elon", "elat", "ecl_lon", "ecl_lat"), "ecliptic")


def as_columns(columns: Any) -> Columns:
    """Columns from None (Gaia's names), "gaia", "vizier" or "icrf", a dict of role to name, or Columns."""
    if columns is None:
        return GAIA
    if isinstance(columns, Columns):
        return columns
    columns = {"names": columns} if isinstance(columns, str) else columns
    if not isinstance(columns, dict):
        raise TableError(
            f"columns are {', '.join(NAMED)}, a dict from role to name, or Columns, not {type(columns).__name__}"
        )
    known = columns.get("names", "gaia")
    if known not in NAMED:
        raise TableError(f"columns: no set of names is called {known!r}; there are {', '.join(NAMED)}")
    columns = {role: name for role, name in columns.items() if role != "names"}
    roles = [f.name for f in fields(Columns)]
    wrong = [str(role) for role in columns if role not in roles]
    if wrong:
        raise TableError(f"columns: nothing is called {', '.join(wrong)}; there are {', '.join(roles)}")
    return replace(NAMED[known], **columns)


def locate(columns: Columns, source: TableSource) -> tuple[dict[str, str], list[str]]:
    """From what a field needs to the names of a table's columns, and notes."""
    where, notes, absent = {}, [], []
    for f in fields(Columns):
        name = getattr(columns, f.name)
        if name is None and f.name not in REQUIRED:
            continue
        if name is None or isinstance(name, str):
            if name not in source.names:
                absent.append((f.name, name))
            else:
                where[f.name] = name
        else:
            present = [candidate for candidate in name if candidate in source.names]
            if present:
                where[f.name] = present[0]
            elif f.name == "pmra_pmdec_corr":
                notes.append(f"no column {' or '.join(name)}: correlations taken as zero")
    if absent:
        (role, name), *others = absent
        also = f"; missing too: {', '.join(printable(other) for _, other in others)}" if others else ""
        fits = [
            known for known, names in NAMED.items() if all(getattr(names, each) in source.names for each in REQUIRED)
        ]
        which = (
            f"columns={fits[0]!r} (--columns {fits[0]})" if fits else f"columns={{{role!r}: …}} (--columns {role}=…)"
        )
        raise TableError(f"{source.label}: {missing_column(name, source)}{also}. Say which it is: {which}")
    return where, notes


def frame_of(where: Mapping[str, str], frame: str | None, meta: Mapping[str, Any] | None = None) -> str:
    """The frame of a table's positions: the one given, that in its header, or by the columns' names ICRS or another."""
    if frame is not None:
        return check_frame(frame)
    stated = next((value for key, value in (meta or {}).items() if str(key).upper() == FRAME_KEY), None)
    if stated in FRAMES:
        return str(stated)
    for role in ("ra", "dec"):
        name = where.get(role)
        known = name and _OTHER_FRAMES.get(name.lower())
        if known:
            raise TableError(
                f"column {name!r} is given as {role}: are these {known} coordinates? Say frame={known!r} "
                f'(--catalogue-frame {known}), or frame="icrs"'
            )
    return "icrs"


def redshift_frame_of(where: Mapping[str, str], source: TableSource) -> str | None:
    """The frame of a table's redshifts, where its metadata or the column's description tell it."""
    if "redshift" not in where:
        return None
    stated = next((value for key, value in source.meta.items() if str(key).upper() == REDSHIFT_FRAME_KEY), None)
    if stated in REDSHIFT_FRAME_NAMES:
        return str(stated)
    return redshift_frame_in(source.descriptions.get(where["redshift"]))


def missing_column(name: str | None, source: TableSource) -> str:
    """What is said of a column that is not there, with the names nearest to it."""
    near = [each for each in source.names if each.lower() == str(name).lower()]
    near = near or get_close_matches(str(name), source.names[:2000], n=3, cutoff=0.6)
    hint = f"; nearest: {', '.join(map(printable, near))}" if near else ""
    shown = list(map(printable, source.names[:200]))
    more = f" and {len(source.names) - 200} more" if len(source.names) > 200 else ""
    return f"no column {printable(name)!r}. The table has {', '.join(shown)}{more}{hint}"


def doubt_positions(columns: Any, assumed: Any, at_least: int = 20) -> None:
    """Raise FieldError where bare positions look like radians or hours rather than degrees."""
    if not assumed or (columns["ra"].size and columns["ra"].max() > 24):
        return
    ra, dec = (np.ma.compressed(columns[role]) for role in ("ra", "dec"))
    if ra.size < at_least or dec.size < at_least:
        return
    with np.errstate(invalid="ignore"):
        small = (ra >= -np.pi).all() and (ra <= 2 * np.pi).all() and (np.abs(dec) <= np.pi / 2).all()
        hours = (ra >= 0).all() and (ra <= 24).all() and np.ptp(ra) > 12 and np.ptp(dec) > 30
    reach = f"{ra.min():.3g} to {ra.max():.3g} and from {dec.min():.3g} to {dec.max():.3g}"
    if small and np.ptp(ra) > 1 and np.ptp(dec) > 0.5:
        raise FieldError(
            f"ra and dec have no unit and reach only from {reach}: radians? Say units={{'ra': 'rad', 'dec': 'rad'}} "
            "(--units ra=rad,dec=rad), or deg if they are degrees"
        )
    if hours:
        raise FieldError(
            f"ra and dec have no unit and reach from {reach}: is ra in hours? Say units={{'ra': 'hourangle'}} "
            "(--units ra=hourangle), or deg if they are degrees"
        )


class Chosen:
    """A condition on one table."""

    def __init__(self, where: str, source: tables.TableSource, roles: Mapping[str, str] | None = None) -> None:
        self._where = tables.Where(where)
        # A role stands for the column that has it, where no column is called so: redshift for redshift_qsoc.
        self._roles = {
            name: (roles or {})[name]
            for name in self._where.names
            if name not in source.names and name in (roles or {})
        }
        self._where.check((*source.names, *self._roles), source.label)
        self.names = tuple(dict.fromkeys(self._roles.get(name, name) for name in self._where.names))

    def of(self, block: Mapping[str, Any], first_row: int) -> tuple[dict[str, Any], Any, list[str]]:
        """The selected rows of a block, their numbers, and a note that counts the others."""
        read = {name: block[self._roles.get(name, name)] for name in self._where.names}
        selected, unknown = self._where.rows(read or block)
        counts = {FALSE: int((~selected & ~unknown).sum()), MISSING: int(unknown.sum())}
        counts = {why: count for why, count in counts.items() if count}
        mark = [
            np.packbits(selected),
            np.array([first_row]),
            *(np.asarray(each) for each, _ in list(block.values())[:2]),
        ]
        note = NotSelected.of_table(counts, len(selected), *mark, names=(self._where.shown,))
        if not selected.any():
            raise nothing_selected((note,))
        rows = np.flatnonzero(selected)
        kept = {
            name: (values[rows], None if mask is None else np.asarray(mask)[rows])
            for name, (values, mask) in block.items()
        }
        return kept, first_row + rows, [note]


def nothing_selected(notes: Iterable[str]) -> NothingSelectedError:
    """The error of a table without a selected row."""
    error = NothingSelectedError("no row is left by --where: " + "; ".join(map(str, notes)))
    error.notes = tuple(notes)
    return error


def factors(where: Mapping[str, str], units: Mapping[str, Any] | None, source: TableSource) -> Any:
    """By which each column of positions, motions and errors is multiplied, and notes on units that were assumed."""
    for name in units or {}:
        if name not in source.names:
            raise TableError(f"units: {missing_column(name, source)}")
    stated, assumed = {}, {}
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
            assumed.setdefault(_text(wanted), []).append(name)
            stated[role] = 1.0
        else:
            stated[role] = _factor(name, unit, wanted, name in (units or {}))
    for role in filter(where.__contains__, FURTHER_UNITS):
        name, wanted = where[role], FURTHER_UNITS[role]
        unit = (units or {}).get(name, source.units.get(name))
        if unit is not None and str(unit).strip():
            stated[role] = _further(role, name, unit, wanted, name in (units or {}))
        elif role in MUST_SAY:
            raise TableError(
                f"column {name!r} has no unit: say which, units={{{name!r}: {str(wanted)!r}}} (--units {name}={wanted})"
            )
    return stated, assumed


@lru_cache
def _text(unit):
    return str(unit)


def differing_units(where: Mapping[str, str], units: Mapping[str, Any]) -> list[str]:
    """A note where motions and their errors are not all in one unit, which is seldom meant."""
    sizes = {role: units[role] for role in ("pmra", "pmdec", "pmra_error", "pmdec_error") if role in units}
    if len({float(f"{size:.9g}") for size in sizes.values()}) < 2:
        return []
    listed = ", ".join(f"{printable(where[role])} in units of {size:.6g} mas/yr" for role, size in sizes.items())
    return [f"proper motions and errors are in different units: is that so? ({listed})"]


def parse_unit(unit: Any) -> Any:
    """A unit from what a table or a user says: in astropy's own spelling, that of FITS, VOTable or CDS."""
    return _parsed(unit) if isinstance(unit, str) else u.Unit(unit)


@lru_cache(1000)
def _parsed(unit):
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
    try:
        parsed = parse_unit(unit)
    except (ValueError, TypeError):
        place = "units" if given else "the table"
        raise TableError(
            f"{place}: {printable(unit)!r}, given for {name}, is no unit that astropy knows: say what it is, "
            f"units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
        ) from None
    if not isinstance(parsed, u.UnitBase):
        raise TableError(
            f"column {name!r} is in {printable(unit)!r}, a logarithm: turn it into a linear unit, {wanted} say"
        )
    try:
        factor = float(parsed.to(wanted))
    except (u.UnitConversionError, ValueError, TypeError, AttributeError):
        raise TableError(
            f"column {name!r} is in {printable(unit)!r}, which cannot be turned into {wanted}: "
            f"if the table is wrong, say what it is, units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
        ) from None
    if not 0 < factor < np.inf:
        raise TableError(f"column {name!r} is in {printable(unit)!r}, a unit that is not positive: signs would turn")
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
                f"column {name!r} is in {printable(unit)!r}, not a redshift: divide velocities by c, or say which "
                f"column has redshifts (--columns {role}=NAME)"
            )
        return 1.0
    return _factor(name, unit, wanted, given)


def plain(name: str, values: Any, missing: BoolArray | None) -> Any:
    """A column of numbers as an array of doubles, masked where values are missing."""
    if missing is None and not np.ma.isMaskedArray(values):
        return as_floats(printable(name), values)[0]
    floats, mask = as_floats(printable(name), np.ma.MaskedArray(values, False if missing is None else missing))
    return np.ma.MaskedArray(floats, mask)


def identifiers(name: str, values: Any, missing: BoolArray | None) -> Any:
    """Names as 64-bit integers or text, and notes; masked integers become text, so that no digit is lost."""
    notes = []
    mask = np.zeros(len(values), bool) if missing is None else missing
    if values.dtype.kind == "f" and not mask.all():
        notes.append(f"warning: {name} is a column of floating-point numbers, so long identifiers have lost digits")
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
        notes.append(f"warning: {repeated} rows repeat the {name} of another row and are used as separate sources")
    return values, notes
