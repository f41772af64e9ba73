"""Where a table keeps what a field needs, and in which units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from astropy import units as u

from vsh.archive import DR3, DR4
from vsh.checks.notebook import InNotebook
from vsh.checks.notes import printable
from vsh.errors import FieldError, TableError
from vsh.sky.frames import FRAME_KEY, FRAMES, check_frame
from vsh.sky.redshift_frames import REDSHIFT_FRAME_KEY, REDSHIFT_FRAME_NAMES, redshift_frame_in
from vsh.tables import TableSource


@dataclass(frozen=True)
class Columns(InNotebook):
    """Where a table keeps what a field needs: a new survey is a new value of this.

    The first six must be there. The others may be left out with None; of several names in
    a tuple the first that the table has is taken, and none need be there. Where there is a `solution`, sources
    whose astrometry is not that of a single source with a parallax (31 or 95, `vsh.archive.DR4`) cannot be used.

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

#: Sets of names that are called by one: the archive's, those of VizieR's tables of Gaia (I/355/gaiadr3, I/350/gaiaedr3), and those that
#: the IERS's lists of ICRF2 and ICRF3 are given, where they are read as tables.
NAMED = {
    "gaia": GAIA,
    "vizier": Columns(
        ra="RA_ICRS", dec="DE_ICRS", pmra="pmRA", pmdec="pmDE", pmra_error="e_pmRA", pmdec_error="e_pmDE", pmra_pmdec_corr=("pmRApmDEcor",),
        name=("Source", "ID", "Name"), magnitude=("Gmag",), redshift=("z", "zsp", "Redshift"), redshift_error=("e_z", "e_zsp"), solution=("Solved",),
    ),
    "icrf": replace(GAIA, name=("iers", "icrf")),
}  # fmt: skip

REQUIRED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
UNITS = dict.fromkeys(("ra", "dec"), u.deg) | dict.fromkeys(REQUIRED[2:], u.mas / u.yr)
#: Of columns that need not be there, in which a field has them.
FURTHER_UNITS = {
    "pmra_pmdec_corr": u.dimensionless_unscaled, "magnitude": u.mag, "redshift": u.dimensionless_unscaled,
    "redshift_error": u.dimensionless_unscaled, "distance": u.Mpc, "distance_error": u.Mpc,
}  # fmt: skip
#: Those whose unit is asked for where a table does not tell it: nobody would see that kpc were taken for Mpc.
MUST_SAY = ("distance", "distance_error")
#: Names that positions have in other frames than the equatorial one.
_OTHER_FRAMES = {"l": "galactic", "b": "galactic", "glon": "galactic", "glat": "galactic", "gal_lon": "galactic",
                 "gal_lat": "galactic", "elon": "ecliptic", "elat": "ecliptic", "ecl_lon": "ecliptic", "ecl_lat": "ecliptic"}  # fmt: skip


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
    where, said, absent = {}, [], []
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
                said.append(f"no column {' or '.join(name)}: correlations taken as zero")
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
    return where, said


def frame_of(where: Mapping[str, str], frame: str | None, meta: Mapping[str, Any] | None = None) -> str:
    """The frame of a table's positions: the one that was told, that of a field that was written, or ICRS if the columns' names say nothing else."""
    if frame is not None:
        return check_frame(frame)
    said = next((value for key, value in (meta or {}).items() if str(key).upper() == FRAME_KEY), None)
    if said in FRAMES:
        return str(said)
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
    said = next((value for key, value in source.meta.items() if str(key).upper() == REDSHIFT_FRAME_KEY), None)
    if said in REDSHIFT_FRAME_NAMES:
        return str(said)
    return redshift_frame_in(source.descriptions.get(where["redshift"]))


def missing_column(name: str | None, source: TableSource) -> str:
    """What is said of a column that is not there, with the names nearest to it."""
    near = [each for each in source.names if each.lower() == str(name).lower()]
    near = near or get_close_matches(str(name), source.names[:2000], n=3, cutoff=0.6)
    hint = f"; nearest: {', '.join(map(printable, near))}" if near else ""
    shown = list(map(printable, source.names[:200]))
    more = f" and {len(source.names) - 200} more" if len(source.names) > 200 else ""
    return f"no column {printable(name)!r}. The table has {', '.join(shown)}{more}{hint}"


def doubt_positions(found: Any, assumed: Any, at_least: int = 20) -> None:
    """Raise FieldError where bare positions look like radians or hours rather than degrees."""
    ra, dec = (np.ma.compressed(found[role]) for role in ("ra", "dec"))
    if not assumed or ra.size < at_least or dec.size < at_least:
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
