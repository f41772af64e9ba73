"""Lists of positions from VLBI: ICRF2 and ICRF3, the .crf and .sou of IVS analysis centres, RFC, VieVS.

One line is one source: names and flags, right ascension in hours and declination in degrees, each as three numbers,
and behind them the errors of both and their correlation. Errors of right ascension are without cos δ in all of them.

References: IERS Technical Note 35 (ICRF2); Charlot et al. 2020, A&A 644, A159 (ICRF3); Petrov & Kovalev 2025, ApJS
276, 38 (RFC); for getpar's .sou and the .crf of the IVS, what their headers say.
"""

import re
from dataclasses import replace

import numpy as np

from vsh.io.tables._source import TableSource, open_other
from vsh.io.tables._text import open_lines
from vsh.tools.errors import TableError
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: Names and flags, hours, minutes and seconds, sign, degrees, minutes and seconds, and the rest.
_ROW = re.compile(
    r"(?P<names>.*?)(?:^|\s)(?P<h>\d+)[ :]+(?P<m>\d+)[ :]+(?P<s>\d+(?:\.\d*)?)\s+"
    r"(?P<sign>[-+]?)\s*(?P<d>\d+)[ :]+(?P<dm>\d+)[ :]+(?P<ds>\d+(?:\.\d*)?)(?P<rest>.*)"
)
#: The lines of getpar: SOU_GCO:  0002+051  R: 00_05_20.21559171 -+  0.1234  D: +05_24_10.8001234 -+  0.1234  C: 0.12 …
_GETPAR = re.compile(
    r"SOU_GCO:\s+(?P<names>\S+)\s+R:\s*(?P<h>\d+)_(?P<m>\d+)_(?P<s>[\d.]+)\s+-\+\s+(?P<e1>\S+)\s+"
    r"D:\s*(?P<sign>[-+]?)(?P<d>\d+)_(?P<dm>\d+)_(?P<ds>[\d.]+)\s+-\+(?P<rest>.*)"
)
_NUMBER = re.compile(r"[-+]?\d*\.?\d+")
_COMMENT = ("#", "*", "!", "%", "$")
_DESIGNATION = re.compile(r"J\d{4}\S*")
_MAS_WORDS = ("VLBI SOURCE POSITION CATALOGUE", "Radio Fundamental Catalogue", "RFC J")
#: No list of compact radio sources is as uncertain as this in the median: its errors are in another unit. [arcsec]
_LARGEST = 2.0


def open_vlbi(path: PathName, label: str) -> TableSource:
    """A list of positions as a table: names, D marks, degrees, and errors in mas, of right ascension times cos δ."""
    with open_lines(path, label) as opened:
        lines = list(opened)
    numbered = [(k, line.rstrip("\r\n")) for k, line in enumerate(lines, 1)]
    getpar = any(line.startswith("SOU_GCO:") for _, line in numbered)
    pattern = _GETPAR if getpar else _ROW
    rows = [(k, line) for k, line in numbered if line.strip() and not line.startswith(_COMMENT)]
    first = next((i for i, (_, line) in enumerate(rows) if pattern.match(line) or _like_a_row(line)), None)
    if first is None:
        raise TableError(f"{label} has no line with a position in hours and degrees: is it a list of VLBI positions?")
    # Above the first source is the heading; below it, every line that is not blank is a source.
    rows = [(k, line) for k, line in rows[first:] if any(map(str.isalnum, line))]
    icrf = rows[0][1].startswith("ICRF J")
    parsed = [_parse(label, k, line, pattern, icrf) for k, line in rows]
    mas = getpar or any(word in line for _, line in numbered for word in _MAS_WORDS)
    return _table(label, rows, parsed, mas)


def _like_a_row(line):
    """Whether a line is a source, perhaps a damaged one, and no heading: so many numbers stand in no heading."""
    return line.startswith("ICRF J") or sum(_NUMBER.fullmatch(word) is not None for word in line.split()) > 6


def _table(label, rows, parsed, mas):
    names, positions, rests = zip(*parsed, strict=True)
    if len(rests) > 2 and len(rests[-1]) < min(map(len, rests[:-1])):
        number, line = rows[-1]
        shown = printable(line.strip()[:80])
        raise TableError(f"{label}, line {number} is damaged: the list ends within it: {shown!r}")
    lon, lat = np.array(positions).T
    columns = {
        "icrf": np.array([icrf for icrf, _, _ in names]),
        "iers": np.array([name for _, name, _ in names]),
        "defining": np.where([mark for *_, mark in names], "D", ""),
        "ra": lon,
        "dec": lat,
    }
    units = {"ra": "deg", "dec": "deg"}
    notes: tuple[str, ...] = ()
    epochs = [len(rest) > 0 and re.fullmatch(r"(19|20)\d\d(\.\d*)?", rest[0]) is not None for rest in rests]
    if all(epochs) or not any(rests):  # the catalogue of VieVS has an epoch there, and no errors
        notes = ("the list has no errors",)
    else:
        errors = np.array([_errors(label, k, line, rest) for (k, line), rest in zip(rows, rests, strict=True)])
        scale = 1.0 if mas else 1000.0
        if np.median(errors[:, 1]) * scale > 1000 * _LARGEST:
            raise TableError(
                f"{label}: errors of declination are {np.median(errors[:, 1]) * scale / 1000:.3g} arcsec in the median "
                f"if in {'mas' if mas else 'arcsec'}: another unit? Make it a table with units (CSV, ECSV)"
            )
        east = errors[:, 0] * scale * (1.0 if mas else 15.0) * np.cos(np.radians(lat))
        columns |= {"ra_error": east, "dec_error": errors[:, 1] * scale, "ra_dec_corr": errors[:, 2]}
        units |= {"ra_error": "mas", "dec_error": "mas"}
        which = "mas" if mas else "seconds of time and arcsec"
        notes = (
            f"errors of the list taken in {which}, of right ascension without cos δ, by which they were multiplied",
        )
    table = replace(open_other(columns), label=label, units=units)
    return replace(table, notes=notes)


def _parse(label, number, line, pattern, icrf):
    """Names, the position [deg], and the words behind it."""
    shown = printable(line.strip()[:80])
    if icrf and not re.match(r"\s*(ICRF(\s|$)|-\s|\s)", line + " "):
        raise TableError(f"{label}, line {number} is damaged: it does not begin with 'ICRF J': {shown!r}")
    match = pattern.match(line)
    if match is None:
        raise TableError(f"{label}, line {number} is damaged: {shown!r}")
    hours, minutes, degrees, arcmin = (int(match[key]) for key in ("h", "m", "d", "dm"))
    seconds, arcsec = float(match["s"]), float(match["ds"])
    lon = 15 * (hours + minutes / 60 + seconds / 3600)
    size = degrees + arcmin / 60 + arcsec / 3600
    whole = hours < 24 and minutes < 60 and seconds < 60 and arcmin < 60 and arcsec < 60
    if not (whole and size <= 90):
        raise TableError(f"{label}, line {number} has no position on the sky: {shown!r}")
    rest = match["rest"].split()
    if pattern is _GETPAR:
        rest = [match["e1"], *(word for word in rest if word != "C:")]
    return _names(match["names"]), (lon, -size if match["sign"] == "-" else size), rest


def _names(text):
    """Designation by J2000.0 coordinates, the other name, and whether the source is defining."""
    words = [word for word in text.split() if word not in ("ICRF", "RFC", "-")]
    mark = "D" in words[1:]
    words = [word for k, word in enumerate(words) if k == 0 or len(word) > 1]
    words = [word for k, word in enumerate(words) if len(word) > 1 or len(words) == 1]
    designation = next((word for word in words if _DESIGNATION.fullmatch(word)), "")
    others = [word for word in words if word != designation]
    return designation, others[-1] if others else designation, mark


def _errors(label, number, line, rest):
    shown = printable(line.strip()[:80])
    try:
        errors = [float(word) for word in rest[:3]]
        east, north, rho = errors
    except ValueError:
        raise TableError(f"{label}, line {number} is damaged: {shown!r}") from None
    if not (np.isfinite(errors).all() and east > 0 and north > 0 and abs(rho) < 1):
        raise TableError(f"{label}, line {number} has no usable errors: {shown!r}")
    return errors
