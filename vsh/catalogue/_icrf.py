"""The International Celestial Reference Frame as the IERS hands it round: ICRF2 and ICRF3 in fixed-width columns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vsh import tables
from vsh.checks.notes import printable
from vsh.checks.types import PathName
from vsh.errors import TableError
from vsh.sky.positions import Positions
from vsh.units import DEGREE, MAS


def read_icrf(path: PathName, name: str | None = "icrf") -> Positions:
    """Read a catalogue of VLBI positions in the layout of ICRF2 or ICRF3.

    Parameters
    ----------
    path : str or Path
        The file.
    name : {"icrf", "iers"}
        Which designation names the sources: J000020.3-322101 or 2357-326.

    Returns
    -------
    Positions
        Errors of right ascension are multiplied by 15 cos δ; `defining` holds the D marks.

    Raises
    ------
    TableError
        If the file cannot be read, holds no such lines, or one of them is damaged; the message
        names the line.
    """
    if name not in ("icrf", "iers"):
        raise TableError(f"sources are named by icrf or iers, not {name!r}")
    icrf, iers, defining, *numbers = _columns(path)
    lon, lat, east, north, rho = np.array(numbers)
    names = np.array(icrf if name == "icrf" else iers)
    return Positions(lon, lat, np.stack([east, north]), rho, name=names, defining=np.array(defining))


def open_icrf(source: Any, format: str | None = None) -> tables.TableSource:
    """A table that is open, of any format that a catalogue may come in."""
    if format != "icrf" or isinstance(source, tables.TableSource):
        return tables.open_table(source, format)
    icrf, iers, defining, *numbers = _columns(source)
    lon, lat, east, north, rho = np.array(numbers)
    columns = {"icrf": np.array(icrf), "iers": np.array(iers), "defining": np.where(defining, "D", "")}
    columns |= {
        "ra": lon / DEGREE,
        "dec": lat / DEGREE,
        "ra_error": east / MAS,
        "dec_error": north / MAS,
        "ra_dec_corr": rho,
    }
    units = {"ra": "deg", "dec": "deg", "ra_error": "mas", "dec_error": "mas"}
    return replace(tables.open_table(tables.table_of(columns, units=units)), label=printable(source))


def _columns(path):
    """Designations, D marks, angles [rad], errors [µas] and correlations, each of all sources."""
    label = printable(path)
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise TableError(f"{label} cannot be read: {error.strerror}") from error
    first = next((number for number, line in enumerate(lines) if line.startswith("ICRF J")), None)
    if first is None:
        raise TableError(f"{label} has no line that begins with 'ICRF J': is it a catalogue of ICRF2 or ICRF3?")
    # Above the first source is the heading; below it, every line that is not blank is a source.
    rows = [(number, line) for number, line in enumerate(lines[first:], first + 1) if line.strip()]
    parsed = [_parse(label, number, line) for number, line in rows]
    return list(zip(*parsed, strict=True))


def _parse(label, number, line):
    """Names, D mark, angles [rad], errors of α cos δ and δ [µas], correlation."""
    shown = printable(line.strip()[:80])
    if not line.startswith("ICRF J"):
        raise TableError(f"{label}, line {number} is damaged: it does not begin with 'ICRF J': {shown!r}")
    try:
        _, icrf, iers, *rest = line.split()
        defining = rest[0].isalpha()
        hours, minutes, seconds, degrees, arcmin, arcsec, sigma_ra, sigma_dec, rho = rest[defining : defining + 9]
        whole = 0 <= int(hours) < 24 and 0 <= int(minutes) < 60 and 0 <= int(arcmin) < 60
        on_sky = whole and 0 <= float(seconds) < 60 and 0 <= float(arcsec) < 60
        lon = np.radians(15 * (int(hours) + int(minutes) / 60 + float(seconds) / 3600))
        size = abs(int(degrees)) + int(arcmin) / 60 + float(arcsec) / 3600
        lat = np.radians(-size if degrees.startswith("-") else size)  # −00 degrees are negative too
        east, north = 15e6 * float(sigma_ra) * np.cos(lat), 1e6 * float(sigma_dec)
        found = lon, lat, east, north, float(rho)
    except (ValueError, IndexError):
        raise TableError(f"{label}, line {number} is damaged: {shown!r}") from None
    if not (on_sky and abs(lat) <= np.pi / 2):
        raise TableError(f"{label}, line {number} has no position on the sky: {shown!r}")
    if not (np.isfinite(found).all() and east > 0 and north > 0 and abs(found[4]) < 1):
        raise TableError(f"{label}, line {number} has no usable errors: {shown!r}")
    return icrf, iers, defining and rest[0] == "D", *found
