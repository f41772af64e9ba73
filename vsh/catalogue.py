"""From a table to a Field: columns, units, masks, and counts of what was refused."""

from dataclasses import dataclass, fields
from difflib import get_close_matches
from warnings import warn

import numpy as np
from astropy import units as u

from vsh import tables
from vsh.errors import FieldError, TableError, VshWarning
from vsh.field import Field
from vsh.gate import as_floats
from vsh.icrf import read_icrf
from vsh.match import match
from vsh.truth import truth_of
from vsh.units import MAS

__all__ = [
    "GAIA", "Columns", "iter_fields", "match", "read_field", "read_icrf", "truth_of", "write_field",
]  # fmt: skip


@dataclass(frozen=True)
class Columns:
    """Where a table keeps what a field needs: a new survey is a new value of this.

    The first six must be there. The others may be left out with None; of several names in
    a tuple the first that the table has is taken, and none need be there.

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
    pmra_pmdec_corr: str = ("pmra_pmdec_corr",)
    name: str = ("source_id", "name", "designation")
    magnitude: str = ("phot_g_mean_mag",)
    redshift: str = ("redshift", "z", "redshift_qsoc")


#: Gaia's archive names.
GAIA = Columns()

_REQUIRED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
_UNITS = dict.fromkeys(("ra", "dec"), u.deg) | dict.fromkeys(_REQUIRED[2:], u.mas / u.yr)


def read_field(source, columns=None, units=None, on_bad="raise", frame="icrs"):
    """Read a field from a table.

    Parameters
    ----------
    source : path, astropy Table or QTable, pandas DataFrame, dict or structured array
        Files: FITS, VOTable, ECSV, CSV, Parquet.
    columns : Columns or dict, optional
        Where the table keeps what; Gaia's archive names unless given.
    units : dict, optional
        From column names of the table to units, "uas/yr" say; they override the table's.
        A column without a unit is taken in Gaia's (deg, mas/yr) if it has Gaia's name,
        and a note says so.
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used.
    frame : str
        Of positions and motions.

    Returns
    -------
    Field
        Its `notes` say what was assumed and what was left out.

    Raises
    ------
    TableError
        If the file cannot be read, a column is missing, or a unit is missing or wrong.
    FieldError
        If a column holds no numbers, or if rows cannot be used.

    Examples
    --------
    >>> field = read_field({"ra": [10.0], "dec": [-20.0], "pmra": [0.1], "pmdec": [0.2],
    ...                     "pmra_error": [0.05], "pmdec_error": [0.05]})
    >>> field.notes[0]
    'no unit in the table, so taken in deg: ra, dec'
    """
    table = tables.as_table(source)
    columns = as_columns(columns)
    units = _as_units(units, table)
    said, found = [], {}
    for role, name in _locate(columns, table, said).items():
        if role in _REQUIRED:
            found[role] = _in_unit(role, name, table[name], units, said)
        else:
            found[role] = _identifiers(table[name], said) if role == "name" else _plain(name, table[name])
    said = _gather(said)
    _doubt_radians(found, said)
    with np.errstate(invalid="ignore"):
        field = Field.from_columns(**found, frame=frame, on_bad=on_bad, notes=said)
    for note in said:
        if note.startswith("careful"):
            warn(note, VshWarning, stacklevel=2)
    return field


def iter_fields(path, rows=1_000_000, columns=None, units=None, on_bad="raise", frame="icrs"):
    """Read a catalogue larger than memory, a field of at most `rows` sources at a time.

    Parameters
    ----------
    path : str or Path — a FITS file, a Parquet file, or a folder of Parquet files
    rows : int
    columns, units, on_bad, frame
        As for `read_field`.

    Yields
    ------
    Field
        ``fit.normal_equations(iter_fields(path), modes)`` fits them all in one pass.

    Raises
    ------
    TableError, FieldError
        As `read_field` does.
    """
    from vsh.streams import iter_tables

    for table in iter_tables(path, rows):
        yield read_field(table, columns, units, on_bad, frame)


def write_field(field, path, meta=None):
    """Write a field as a table in Gaia's names and units, which `read_field` reads.

    Parameters
    ----------
    field : Field
    path : str or Path — its ending tells the format
    meta : dict, optional — plain values, kept with the table
    """
    columns = {"source_id": np.arange(1, len(field) + 1) if field.name is None else field.name}
    columns |= {"ra": np.degrees(field.lon), "dec": np.degrees(field.lat)}
    columns |= {"pmra": field.motion[0] / MAS, "pmdec": field.motion[1] / MAS}
    columns |= {"pmra_error": field.sigma[0] / MAS, "pmdec_error": field.sigma[1] / MAS, "pmra_pmdec_corr": field.rho}
    optional = {"phot_g_mean_mag": field.magnitude, "redshift": field.redshift}
    columns |= {name: values for name, values in optional.items() if values is not None}
    tables.write(path, columns, meta, {role: str(unit) for role, unit in _UNITS.items()})


def as_columns(columns):
    if columns is None:
        return GAIA
    if isinstance(columns, dict):
        roles = [f.name for f in fields(Columns)]
        wrong = [role for role in columns if role not in roles]
        if wrong:
            raise TableError(f"columns: nothing is called {', '.join(wrong)}; there are {', '.join(roles)}")
        return Columns(**columns)
    return columns


def _as_units(units, table):
    parsed = {}
    for name, unit in (units or {}).items():
        if name not in table.colnames:
            raise TableError(f"units: {_missing(name, table)}")
        try:
            parsed[name] = u.Unit(unit)
        except (ValueError, TypeError):
            raise TableError(f"units: {unit!r}, given for {name}, is no unit that astropy knows") from None
    return parsed


def _locate(columns, table, said):
    """From what a field needs to the name of the table's column."""
    where = {}
    for f in fields(Columns):
        name = getattr(columns, f.name)
        if name is None:
            continue
        if isinstance(name, str):
            if name not in table.colnames:
                raise TableError(
                    f"{_missing(name, table)}. Say which it is: columns={{{f.name!r}: …}} (--columns {f.name}=…)"
                )
            where[f.name] = name
        else:
            present = [candidate for candidate in name if candidate in table.colnames]
            if present:
                where[f.name] = present[0]
            elif f.name == "pmra_pmdec_corr":
                said.append(f"no column {' or '.join(name)}: correlations taken as zero")
    return where


def _missing(name, table):
    near = get_close_matches(name, table.colnames, n=3, cutoff=0.6)
    hint = f"; nearest: {', '.join(near)}" if near else ""
    return f"no column {name!r}. The table has {', '.join(table.colnames)}{hint}"


def _in_unit(role, name, column, units, said):
    """A column as a masked array in the unit that Field.from_columns takes bare."""
    wanted = _UNITS[role]
    unit = units.get(name, getattr(column, "unit", None))
    if unit is None or str(unit) == "":
        if name != getattr(GAIA, role):
            raise TableError(
                f"column {name!r} has no unit: say which, units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
            )
        said.append((str(wanted), name))
        unit = wanted
    try:
        factor = u.Unit(unit).to(wanted)
    except (u.UnitConversionError, ValueError, TypeError, AttributeError):
        raise TableError(
            f"column {name!r} is in {str(unit)!r}, which cannot be turned into {wanted}: "
            f"if the table is wrong, say what it is, units={{{name!r}: {str(wanted)!r}}} (--units {name}=…)"
        ) from None
    # The numbers alone: a Quantity column's own unit has just been used.
    return _plain(name, column) * factor


def _plain(name, column):
    """A column as a masked array of bare numbers."""
    values, missing = as_floats(name, getattr(column, "value", column))
    return np.ma.MaskedArray(values, missing | np.asarray(getattr(column, "mask", False)))


def _identifiers(column, said):
    """Names as 64-bit integers or text; masked integers become text, so that no digit is lost."""
    mask = np.asarray(getattr(column, "mask", False))
    values = np.ma.getdata(np.asarray(column))
    if values.dtype.kind == "f":
        said.append(
            f"careful: {column.name} is a column of floating-point numbers, so long identifiers have lost digits"
        )
    if mask.any() or values.dtype.kind not in "iuSU":
        values = np.where(mask, "", values.astype(str))
    if values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    elif values.dtype.kind in "iu":
        values = values.astype(values.dtype.newbyteorder("="))
    named = values[values != ""] if values.dtype.kind == "U" else values
    repeated = len(named) - len(np.unique(named))
    if repeated:
        said.append(f"careful: {repeated} rows repeat the {column.name} of another and count again")
    return values


def _gather(said):
    """Notes, with the columns whose unit was assumed in one line a unit."""
    assumed = {}
    for note in said:
        if isinstance(note, tuple):
            assumed.setdefault(note[0], []).append(note[1])
    lines = [f"no unit in the table, so taken in {unit}: {', '.join(names)}" for unit, names in assumed.items()]
    return lines + [note for note in said if isinstance(note, str)]


def _doubt_radians(found, said, at_least=20):
    """Bare positions that all lie within 2π and ±π/2 of the origin are radians, not a small field."""
    ra, dec = found["ra"].compressed(), found["dec"].compressed()
    assumed = any(note.startswith("no unit") and "ra" in note.split(": ")[1].split(", ") for note in said)
    if not assumed or ra.size < at_least:
        return
    with np.errstate(invalid="ignore"):
        inside = (ra >= -np.pi).all() and (ra <= 2 * np.pi).all() and (np.abs(dec) <= np.pi / 2).all()
    if inside and np.ptp(ra) > 1 and np.ptp(dec) > 0.5:
        raise FieldError(
            f"ra and dec have no unit and reach only from {ra.min():.3g} to {ra.max():.3g} and from {dec.min():.3g} to "
            f"{dec.max():.3g}: radians? Say units={{'ra': 'rad', 'dec': 'rad'}} (--units ra=rad,dec=rad), "
            "or deg if they are degrees"
        )
