"""In which axes the positions and motions of a table are: as asked, as it states, or by the names of its columns."""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from vsh.io.catalogue._names import split_name_and_unit
from vsh.io.tables import TableSource
from vsh.sky.frames import (
    FRAME_KEY,
    FRAMES,
    REDSHIFT_FRAME_KEY,
    REDSHIFT_FRAME_NAMES,
    check_frame,
    parse_redshift_frame,
    rotation_matrix,
)
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import TableError
from vsh.tools.printing import printable

_POSITIONS = ("ra", "dec")
#: Names of positions and of motions by which axes are known, compared without case and signs.
_BY_NAME = {
    "galactic": ("l", "b", "glon", "glat", "gallon", "gallat", "lii", "bii", "lgal", "bgal"),
    "ecliptic": ("elon", "elat", "ecllon", "ecllat", "eclipticlon", "eclipticlat"),
}
_B1950_NAME = re.compile(r"B1950|1950|FK4", re.IGNORECASE)
#: Names of supergalactic longitudes and latitudes, and of motions along them.
_SUPERGALACTIC_NAME = re.compile(r"(pm_?|mu_?|e_?)*(sg_?(l|b|lon|lat)|super_?gal\w*)", re.IGNORECASE)
_MOTIONS = {
    "icrs": re.compile(r"(pm|mu|e?pm)_?(ra|alpha|de|dec|delta|ra_?cos_?dec|alpha_?(star|\*))\*?", re.IGNORECASE),
    "galactic": re.compile(r"(pm|mu)_?g?(al)?_?(l|b|lon|lat|l_?cos_?b)\*?", re.IGNORECASE),
    "ecliptic": re.compile(r"(pm|mu)_?e(cl)?_?(lon|lat|lon_?cos_?lat)\*?", re.IGNORECASE),
}
#: What makes the name of a motion that of its error.
_ERROR_WORDS = re.compile(r"^e_(?=.*[a-z]{2})|_?(err(or)?|sig(ma)?|unc|std|stderr)s?(?=_|$)|^sig(ma)?_?", re.IGNORECASE)
#: Systems that headers name, of FITS (RADESYS) and of VOTables (COOSYS), in small letters.
_SYSTEMS = {
    "icrs": "icrs", "galactic": "galactic", "gal_ii": "galactic", "galactic_ii": "galactic",
    "ecl_fk5": "ecliptic", "ecliptic": "ecliptic", "ecl": "ecliptic", "barycentricmeanecliptic": "ecliptic",
    "eq_fk5": "fk5", "fk5": "fk5", "eq_fk4": "fk4", "fk4": "fk4", "fk4-no-e": "fk4", "fk4_no_e": "fk4",
    "ecl_fk4": "fk4", "supergalactic": "super", "super_galactic": "super", "gal_i": "super",
}  # fmt: skip


class TableFrames(NamedTuple):
    """The axes of a table.

    Attributes
    ----------
    frame : str
        That of its motions, and of the field that is read.
    positions : str
        That of its positions, which are turned to `frame` where they differ.
    notes : tuple of str
        What the reader should know.
    """

    frame: str
    positions: str
    notes: tuple[str, ...] = ()


def find_frames(column_of: Mapping[str, str], frame: str | None, source: TableSource) -> TableFrames:
    """The axes of a table: those asked for, those it states of itself, or by the names of its columns.

    If positions have names of one frame and motions those of ICRS (l, b, pmra, pmdec), they are in these two frames.

    Raises
    ------
    TableError
        If the table states axes that are not read, or names alone do not tell them.
    """
    ra_frame = _find_position_frame(column_of.get("ra"), column_of.get("dec"))
    labels = [column_of.get(role, "") for role in (*_POSITIONS, "pmra", "pmdec")]
    b1950_names, supergalactic = filter(_B1950_NAME.search, labels[:2]), filter(_SUPERGALACTIC_NAME.fullmatch, labels)
    for kind, matches in (("positions of B1950", b1950_names), ("supergalactic axes", supergalactic)):
        if frame is None and (name := next(matches, None)):
            raise TableError(
                f"column {printable(name)!r}: {kind} are not read. Turn them to ICRS first, or say frame= (--columns "
                "frame=) if the name is wrong"
            )
    motion_frame = _find_motion_frame(column_of)
    _check_error_axes(column_of, motion_frame)
    stated, notes = (None, ()) if frame is not None else _read_stated_frame(column_of, source)
    known_frame = check_frame(frame) if frame is not None else stated if ra_frame in (None, stated) else None
    if ra_frame and motion_frame == "icrs" and known_frame in (None, ra_frame):
        names = ", ".join(printable(column_of[role]) for role in (*_POSITIONS, "pmra", "pmdec"))
        note = f"{names}: {ra_frame} positions, turned to ICRS, in whose axes the motions are by their names"
        return TableFrames("icrs", ra_frame, (*notes, note))
    if known_frame is not None:
        return TableFrames(known_frame, known_frame, notes)
    if ra_frame and (motion_frame == ra_frame or "pmra" not in column_of):
        return TableFrames(ra_frame, ra_frame, (f"{ra_frame} axes, by the names of the columns",))
    if ra_frame:
        role = next(role for role in _POSITIONS if _find_position_frame(column_of.get(role)))
        raise TableError(
            f"column {column_of[role]!r} is given as {role}: are these {ra_frame} coordinates? Say frame={ra_frame!r} "
            f'(--columns frame={ra_frame}), or frame="icrs"'
        )
    return TableFrames("icrs", "icrs", notes)


def _find_position_frame(*names):
    """The frame that names of positions are of, other than ICRS."""
    plain_names = [re.sub(r"[^a-z]", "", split_name_and_unit(name)[0].lower()) for name in names if name]
    return next((frame for frame, known in _BY_NAME.items() if any(name in known for name in plain_names)), None)


def _find_motion_frame(column_of, suffix=""):
    """The frame that the names of both components of the motions are of, or of what has the suffix; or None."""
    names = [column_of[f"{role}{suffix}"] for role in ("pmra", "pmdec") if f"{role}{suffix}" in column_of]
    plain_names = [_ERROR_WORDS.sub("", split_name_and_unit(name)[0]).strip("_ ") for name in names]
    frames = [frame for frame, pattern in _MOTIONS.items() if all(map(pattern.fullmatch, plain_names))]
    return frames[0] if frames and len(names) == 2 else None


def _check_error_axes(column_of, motion_axes):
    """Raise TableError where errors have the names of other axes than the motions have."""
    error_axes = _find_motion_frame(column_of, "_error")
    roles = ("pmra", "pmdec", "pmra_error", "pmdec_error")
    is_of_any_axes = any(re.search(r"(pm|mu)_?(lon|lat)", column_of.get(role, ""), re.IGNORECASE) for role in roles)
    if motion_axes and error_axes and motion_axes != error_axes and not is_of_any_axes:  # longitudes are of any axes
        names = [printable(column_of[role]) for role in roles]
        raise TableError(
            f"motions {names[0]} and {names[1]} are of {motion_axes} axes, errors {names[2]} and {names[3]} of "
            f"{error_axes} ones, by their names: errors and correlations have to be turned with the motions. Read both "
            "in one system and turn the field (Field.to_frame, --frame), or rename the errors if they are of these axes"
        )


def _read_stated_frame(column_of, source):
    """The frame that a table states of itself, or None, and notes."""
    header = {str(key).upper(): value for key, value in source.meta.items()}
    if header.get(FRAME_KEY) in FRAMES:
        return str(header[FRAME_KEY]), ()
    systems = {source.systems[column_of[role]] for role in _POSITIONS if column_of.get(role) in source.systems}
    if not systems:
        systems = {
            (str(header[key]).strip(), header.get("EQUINOX")) for key in ("RADESYS", "RADECSYS") if header.get(key)
        }
        if not systems and _parse_equinox(header.get("EQUINOX")) is not None:
            # FITS standard 4.0, section 8.3: without RADESYS FK4 before 1984, and FK5 from then on.
            systems = {("FK4" if _parse_equinox(header["EQUINOX"]) < 1984 else "FK5", header["EQUINOX"])}
    if len(systems) > 1:
        listing = ", ".join(sorted(printable(name) for name, _ in systems))
        raise TableError(f"{source.label} states several coordinate systems of its positions: {listing}. Say frame=")
    for name, equinox in systems:
        return _find_frame_of_system(name, equinox, source.label)
    return None, ()


def _find_frame_of_system(name, equinox, label):
    """Our frame of a system that a table names, and notes."""
    system = _SYSTEMS.get(name.lower())
    year = _parse_equinox(equinox)
    shown = printable(name if year is None or name.lower().startswith(("icrs", "gal")) else f"{name}, {equinox}")
    remedy = "turn it to ICRS first, or say frame= (--columns frame=) if that is wrong"
    if system in ("fk4", "super") or (system in ("fk5", "ecliptic") and year not in (None, 2000.0)):
        raise TableError(f"{label} states positions in {shown}, which are not read: {remedy}")
    if system is None:
        return None, (f"warning: the coordinate system {shown} of the table is not known; ICRS is assumed",)
    if system == "fk5":
        text = f"the table states {shown}: taken as ICRS, from which FK5 of J2000 differs by 0.02 arcsec, and by a spin"
        return "icrs", (text,)
    return system, () if system == "icrs" else (f"{system} axes, as the table states ({shown})",)


def _parse_equinox(value):
    """The year of an equinox: 2000.0 of J2000, B1950.0 or 1950."""
    match = re.fullmatch(r"\s*[JB]?\s*(\d{4}(?:\.\d*)?)\s*", str(value), re.IGNORECASE)
    return float(match[1]) if match else None


def turn_positions(columns: dict[str, Any], frames: TableFrames) -> None:
    """Turn positions in degrees to the axes of the motions, in place."""
    lon, lat = (np.ma.asarray(columns[role], float) for role in _POSITIONS)
    r = triad(*(np.radians(np.ma.filled(values, np.nan)) for values in (lon, lat)))[2]
    turned = angles(rotation_matrix(frames.positions, frames.frame) @ r)
    missing = np.ma.getmaskarray(lon) | np.ma.getmaskarray(lat)
    for role, values in zip(_POSITIONS, turned, strict=True):
        columns[role] = np.ma.MaskedArray(np.degrees(values), missing) if missing.any() else np.degrees(values)


def find_redshift_frame(column_of: Mapping[str, str], source: TableSource) -> str | None:
    """The frame of a table's redshifts, where its metadata or the column's description tell it."""
    if "redshift" not in column_of:
        return None
    header_frame = next((value for key, value in source.meta.items() if str(key).upper() == REDSHIFT_FRAME_KEY), None)
    if header_frame in REDSHIFT_FRAME_NAMES:
        return str(header_frame)
    return parse_redshift_frame(source.descriptions.get(column_of["redshift"]))


def read_redshift_frame(frame_values: Any, source: TableSource) -> str | None:
    """The frame of redshifts in a column of it, which is the same in all rows."""
    frames = {str(value) for value in np.asarray(frame_values)}
    if len(frames) > 1:
        raise TableError(f"{source.label} has redshifts of several frames, {', '.join(map(printable, sorted(frames)))}")
    return next((frame for frame in frames if frame in REDSHIFT_FRAME_NAMES), None)
