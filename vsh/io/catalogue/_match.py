"""Two catalogues of the same sky: which source is which, and how they differ."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from vsh.field import MEASURED, Field
from vsh.io import tables
from vsh.io.catalogue._columns import RowSelection, check_position_unit, find_column_unit, parse_sexagesimal
from vsh.io.catalogue._frames import find_frames
from vsh.io.catalogue._names import ColumnRequest
from vsh.io.columns import missing_column, unit_factor
from vsh.sky.frames import AXES, Positions
from vsh.sky.sphere import triad
from vsh.tools.arguments import positive
from vsh.tools.bad_rows import RHO2_LIMIT, as_floats_and_mask, select_usable_rows
from vsh.tools.errors import FieldError, FrameError, TableError
from vsh.tools.notes import DOUBT, CodedNote
from vsh.tools.printing import one_line_text, printable
from vsh.tools.types import IntArray, OnBad, PathName
from vsh.tools.units import DEGREE, MAS, UAS


class MatchResult(NamedTuple):
    """Sources that two catalogues have in common.

    Attributes
    ----------
    a, b : (k,) int arrays
        Indices of the matched sources in the first and in the second catalogue.
    ambiguous : int
        Sources left out for several counterparts.
    """

    a: IntArray
    b: IntArray
    ambiguous: int


_RELEASE_ID = re.compile(r"e?dr\d\w*_source_id", re.IGNORECASE)


def rename_sources(catalogue: Any, crosswalk: Any) -> Any:
    """A catalogue of one release with the identifiers of another, by a table of neighbours of Gaia's archive.

    Parameters
    ----------
    catalogue : Positions or Field
        Its names are in one of the two columns of identifiers.
    crosswalk : path or table
        As `vsh-archive dr3-neighbourhood` fetches it: dr3_source_id, dr4_source_id, and perhaps angular_distance. Of
        several neighbours the nearest is taken; two sources with the same one are both left out.

    Raises
    ------
    TableError
        If the table has not two columns of identifiers, or none has the names of the catalogue.
    FieldError
        If the catalogue has no names.
    """
    if catalogue.name is None:
        raise FieldError("a catalogue has no names that a crosswalk could turn into others")
    table = tables.open_table(crosswalk)
    columns = [name for name in table.names if _RELEASE_ID.fullmatch(name)]
    if len(columns) != 2:
        raise TableError(f"{table.label} is no crosswalk: it has {len(columns)} columns such as dr3_source_id, not two")
    distances = [name for name in ("angular_distance",) if name in table.names]
    crosswalk_columns = table.columns((*columns, *distances))
    is_absent = np.logical_or.reduce([mask for _, mask in crosswalk_columns.values() if mask is not None] or [False])
    is_known = np.broadcast_to(~is_absent, len(crosswalk_columns[columns[0]][0]))
    values = {name: np.asarray(column)[is_known] for name, (column, _) in crosswalk_columns.items()}
    order = np.argsort(values[distances[0]], kind="stable") if distances else np.arange(len(values[columns[0]]))
    names = np.asarray(catalogue.name).astype(str)
    ours, theirs = sorted(columns, key=lambda name: -np.isin(values[name].astype(str), names).sum())
    nearest_row = {str(values[ours][row]): row for row in order[::-1]}
    rows = np.array([nearest_row.get(name, -1) for name in names])
    if (rows < 0).all():
        raise TableError(f"{table.label}: neither {columns[0]} nor {columns[1]} holds the names of the catalogue")
    new_names = values[theirs][rows]
    _, inverse, counts = np.unique(new_names[rows >= 0], return_inverse=True, return_counts=True)
    selection = rows >= 0
    selection[selection] = counts[inverse] == 1
    renamed = replace(catalogue[selection], name=new_names[selection])
    n_shared = int((rows >= 0).sum() - selection.sum())
    reason = f"; {n_shared} that share one are left out" if n_shared else ""
    note = f"{selection.sum()} of {len(names)} sources have a name of their own in {theirs} by {table.label}{reason}"
    return replace(renamed, notes=(*renamed.notes, note))


def counterparts(a: Any, b: Any, *, by: Literal["name", "position"] = "name", radius: Any = None) -> MatchResult:
    """Match the sources of two catalogues one to one, in the order of the first."""
    types = {type(catalogue) for catalogue in (a, b)}
    if types not in ({Positions}, {Field}):
        raise FieldError("match Positions or Fields: " + " and ".join(type(x).__name__ for x in (a, b)) + " differ")
    if a.frame != b.frame:
        raise FrameError(f"the catalogues are in {a.frame} and {b.frame}: take both to one frame")
    if not isinstance(by, str) or by not in ("name", "position"):
        raise FieldError(f'match by "name" or "position", not {by!r}')
    if types == {Positions}:
        b = b.at_epoch(a.epoch)
    (i, j), ambiguous = (
        _match_by_name(a, b) if by == "name" else _match_by_position(a, b, 1.0 if radius is None else float(radius))
    )
    if not len(i):
        alternative = 'position, by="position" (--match 1)' if by == "name" else "name, or a larger radius"
        raise TableError(
            f"the catalogues have no source in common ({len(a)} and {len(b)}, matched by {by}): match them by "
            f"{alternative}"
        )
    return MatchResult(i, j, ambiguous)


#: Epochs that are further apart are said. [yr]
_SAME_EPOCH = 3.0
#: A larger part of the pairs that is far apart is no slip of a few names.
_FAR_APART = 0.02


class Offsets(Field):
    """Differences of position of n sources: a field as any, of Δα cos δ and Δδ in µas."""

    unit = "µas"

    def _make_table_columns(self):
        columns, units, facts = super()._make_table_columns()
        names = {name: name.replace("pm", "d") for name in columns}  # dra, ddec, dra_error, … in place of pmra, …
        units = {names[name]: unit.removesuffix(" / yr") for name, unit in units.items()}
        return {names[name]: values for name, values in columns.items()}, units, facts


def match(
    a: Any, b: Any, *, by: Literal["name", "position"] = "name", radius: Any = None, pairs: MatchResult | None = None
) -> Field:
    """The differences a − b of two catalogues, with the sum of their covariances.

    Parameters
    ----------
    a, b : Positions, or Fields
        Positions give differences of position, Δα cos δ and Δδ [µas], those of `b` carried to
        the epoch of `a` where both are known; Fields give differences of motion [µas/yr].
    by : {"name", "position"}
        By identifiers that are equal, or by the nearest position.
    radius : float, optional
        How far apart two positions of one source may be; 1 unless given. [arcsec]
    pairs : MatchResult, optional
        Result of `counterparts` with the same `by`, where it is known already.

    Returns
    -------
    Field
        At the positions of `a`, one to one: a source with two possible counterparts is left
        out. Its notes count what was matched, ambiguous and left over. Of positions its `unit` is µas.

    Raises
    ------
    TableError
        If nothing matches.
    FrameError
        If the catalogues stand in different frames.
    FieldError
        If they are not of one kind, have no names to match by, or sources of one name are not in one place.
    """
    i, j, ambiguous = counterparts(a, b, by=by, radius=radius) if pairs is None else pairs
    are_positions = isinstance(a, Positions)
    b = b.at_epoch(a.epoch) if are_positions else b
    difference = _compute_offsets(a, b, i, j) if are_positions else a.motion[:, i] - b.motion[:, j]
    covariance = _select_covariances(a, i) + _select_covariances(b, j)
    sigma = np.sqrt(covariance[:2])
    unmatched_counts = f"{len(a) - len(i)} of {len(a)} and {len(b) - len(j)} of {len(b)}"
    notes = [
        f"matched {len(i)} sources by {by}; unmatched: {unmatched_counts} (first and second catalogue), {ambiguous} of "
        "them with several counterparts"
    ]
    if are_positions and None not in (a.epoch, b.epoch) and abs(a.epoch - b.epoch) > _SAME_EPOCH:
        text = f"the positions are of {a.epoch:g} and of {b.epoch:g}, and no motions take them to one epoch"
        notes.append(CodedNote(f"warning: {text}: what moves is in the differences", DOUBT))
    if by == "name":
        separation = np.hypot(*difference) if are_positions else _compute_excess_separations(a, b, i, j)
        n_distant = int((separation > 1e6).sum())
        if n_distant > max(_FAR_APART * len(i), 3):
            k = int(np.argmax(separation > 1e6))
            raise FieldError(
                f"{n_distant} of {len(i)} pairs of one name are more than 1 arcsec apart "
                f"({one_line_text(a.name[i[k]])} for one): other sources, or columns and units that were misread; by "
                "position (--match 1) names do not count"
            )
        if n_distant:
            names = ", ".join(one_line_text(name) for name in a.name[i][separation > 1e6][:3])
            notes.append(f"{n_distant} of the pairs are more than 1 arcsec apart ({names}): are they the same sources?")
    rho = covariance[2] / (sigma[0] * sigma[1])
    about: dict[str, Any] = {"name": _pick_if_any(a.name, i), "frame": a.frame, "notes": (*a.notes, *b.notes, *notes)}
    if are_positions:
        return Offsets(a.lon[i], a.lat[i], difference, sigma, rho, **about)
    about |= {column: _pick_if_any(getattr(a, column), i) for column in MEASURED} | {"redshift_frame": a.redshift_frame}
    return Field(a.lon[i], a.lat[i], difference, sigma, rho, **about)


def _match_by_name(a, b):
    if a.name is None or b.name is None:
        raise FieldError(
            f"the {'first' if a.name is None else 'second'} catalogue has no column of names that is known: say which "
            'has them (--columns name=…); by="position" (--match 1) needs none'
        )
    types = a.name.dtype, b.name.dtype
    kinds = {dtype.kind for dtype in types}
    if len(kinds) > 1 and "U" in kinds:  # identifiers, as digits in one of them
        a, b = (replace(catalogue, name=np.char.strip(catalogue.name.astype(str))) for catalogue in (a, b))
        if not np.isin(a.name, b.name).any():
            raise FieldError(
                f"names of type {types[0]} and {types[1]} are never equal, {one_line_text(a.name[0])} and "
                f'{one_line_text(b.name[0])} say: by="position" (--match 1) needs none'
            )
    single_rows = []
    ambiguous = 0
    for catalogue in (a, b):
        unique_names, first_indices, counts = np.unique(catalogue.name, return_index=True, return_counts=True)
        single_rows.append(first_indices[counts == 1])
        has_counterpart = np.isin(unique_names, (b if catalogue is a else a).name)
        ambiguous += int(counts[(counts > 1) & has_counterpart].sum())
    _, i, j = np.intersect1d(a.name[single_rows[0]], b.name[single_rows[1]], assume_unique=True, return_indices=True)
    i, j = single_rows[0][i], single_rows[1][j]
    order = np.argsort(i)
    return (i[order], j[order]), ambiguous


def _match_by_position(a, b, radius):
    if not 0 < radius < 180 * 3600:
        raise FieldError(f"the radius of a match is an angle above zero, not {radius} arcsec")
    chord = 2 * np.sin(radius * DEGREE / 7200)
    from scipy.spatial import cKDTree  # half of what reading a bad file would take

    trees = [cKDTree(triad(catalogue.lon, catalogue.lat)[2].T) for catalogue in (a, b)]
    neighbour_lists = trees[0].query_ball_tree(trees[1], chord)
    counts = np.array([len(neighbours) for neighbours in neighbour_lists])
    reverse_counts = np.bincount([k for neighbours in neighbour_lists for k in neighbours], minlength=len(b))
    i = np.array([k for k, near in enumerate(neighbour_lists) if len(near) == 1 and reverse_counts[near[0]] == 1], int)
    j = np.array([neighbour_lists[k][0] for k in i], int)
    n_with_neighbours = np.count_nonzero(counts) + np.count_nonzero(reverse_counts)
    return (i, j), int(n_with_neighbours - 2 * len(i))


def _compute_offsets(a, b, i, j):
    """Δα cos δ and Δδ along the local axes of a, (2, k). [µas]"""
    p, q, r = triad(a.lon[i], a.lat[i])
    # Differences of unit vectors lose nothing that matters: 1e-16 rad is 2e-5 µas.
    difference = r - triad(b.lon[j], b.lat[j])[2]
    return np.stack([np.sum(difference * p, 0), np.sum(difference * q, 0)]) / UAS


def _compute_excess_separations(a, b, i, j):
    """Separations of the sources of two fields, less their motion in a century, (k,). [µas]"""
    difference = triad(a.lon[i], a.lat[i])[2] - triad(b.lon[j], b.lat[j])[2]
    return np.linalg.norm(difference, axis=0) / UAS - 100 * np.hypot(*a.motion[:, i])


def _select_covariances(catalogue, indices):
    """Variances and covariance, (3, k)."""
    s1, s2 = catalogue.sigma[:, indices]
    return np.stack([s1**2, s2**2, catalogue.rho[indices] * s1 * s2])


def _pick_if_any(column, indices):
    return None if column is None else column[indices]


def read_icrf(path: PathName, name: str | None = "icrf", *, on_bad: OnBad = "raise") -> Positions:
    """Read a catalogue of VLBI positions in the layout of ICRF2 or ICRF3.

    Parameters
    ----------
    path : str or Path
        The file.
    name : {"icrf", "iers"}
        Which designation names the sources: J000020.3-322101 or 2357-326.
    on_bad : {"raise", "drop"}
        What to do about sources without errors; a note counts what was dropped.

    Returns
    -------
    Positions
        Errors of right ascension are multiplied by 15 cos δ; `defining` holds the D marks.

    Raises
    ------
    TableError
        If the file cannot be read, holds no such lines, or one of them is damaged; the message names the line.
    """
    if name not in ("icrf", "iers"):
        raise TableError(f"sources are named by icrf or iers, not {name!r}")
    return read_positions(path, designation=name, format="icrf", on_bad=on_bad)


#: Roles of columns, Gaia's names, and what a column without a unit is in.
_UNITS_BY_ROLE = {"ra": "deg", "dec": "deg", "ra_error": "mas", "dec_error": "mas"}
_OPTIONAL_ROLES = ("ra_dec_corr", "name")
_VIZIER_NAMES = {"ra_error": "e_RA_ICRS", "dec_error": "e_DE_ICRS", "ra_dec_corr": "RADEcor", "name": "Source"}
_IDENTIFIER_NAMES = ("source_id", "name", "source_name", "designation", "iers", "iers_name", "icrf")
#: Median errors without a unit outside these are of no list of positions. [mas]
_PLAUSIBLE_ERRORS = 1e-3, 50.0


def _choose_position_columns(names):
    """The columns of a table that have the roles, of names that are not of other axes; Gaia's where none has."""
    column_of = {role: role for role in (*_UNITS_BY_ROLE, *_OPTIONAL_ROLES)}
    column_set, set_name = ColumnRequest().choose_names(names)
    if set_name not in AXES and {column_set.ra, column_set.dec} <= set(names):
        column_of |= {"ra": str(column_set.ra), "dec": str(column_set.dec)}
        column_of |= {role: name for role, name in _VIZIER_NAMES.items() if role not in names and name in names}
    return column_of


def read_positions(
    source: Any,
    columns: Mapping[str, str] | str | None = None,
    *,
    units: Mapping[str, str] | None = None,
    sigma: float | None = None,
    on_bad: OnBad = "raise",
    frame: str | None = None,
    designation: str = "iers",
    where: str | None = None,
    format: str | None = None,
) -> Positions:
    """Read positions of a reference frame."""
    columns = {"names": columns} if isinstance(columns, str) else dict(columns or {})
    set_name = columns.pop("names", "gaia")
    if set_name not in ("gaia", "icrf"):
        raise TableError(f"columns: no set of names of positions is called {set_name!r}; there are gaia, icrf")
    table_source = tables.open_table(source, format)
    for name in set(units or ()) - set(table_source.names):
        raise TableError(f"units: {missing_column(name, table_source)}")
    is_icrf = {"icrf", "iers", "defining"} <= set(table_source.names)
    unknown_roles = [str(role) for role in columns if role not in (*_UNITS_BY_ROLE, *_OPTIONAL_ROLES)]
    if unknown_roles:
        raise TableError(
            f"columns: nothing of positions is called {', '.join(unknown_roles)}; there are "
            f"{', '.join((*_UNITS_BY_ROLE, *_OPTIONAL_ROLES))}"
        )
    if is_icrf and columns.get("name") not in table_source.names:  # what was said is meant for the other catalogue
        columns.pop("name", None)
    if sigma is not None:
        sigma = positive("sigma", sigma)
    if is_icrf or set_name == "icrf":
        columns = {"name": designation} | columns
    column_of = {role: columns.get(role, name) for role, name in _choose_position_columns(table_source.names).items()}
    column_of |= {"defining": "defining"} if is_icrf else {}
    if "name" not in columns:
        name_by_lower = {name.lower(): name for name in table_source.names}
        column_of["name"] = next((name_by_lower[name] for name in _IDENTIFIER_NAMES if name in name_by_lower), "name")
    has_errors = {column_of["ra_error"], column_of["dec_error"]} <= set(table_source.names)
    if sigma is not None and not has_errors:
        column_of.pop("ra_error"), column_of.pop("dec_error"), column_of.pop("ra_dec_corr")
    for role in (*_UNITS_BY_ROLE, *columns):
        if role in column_of and column_of[role] not in table_source.names:
            remark = "; or one error for all: sigma=200 (--columns sigma=200) [µas]" if role.endswith("error") else ""
            raise TableError(missing_column(column_of[role], table_source) + remark)
    column_of = {role: name for role, name in column_of.items() if name in table_source.names}
    frames = find_frames(column_of, frame, table_source)
    selection = None if where is None else RowSelection(where, table_source)
    epochs = tuple(name for name in ("ref_epoch",) if name in table_source.names)
    used = (*column_of.values(), *(selection.names if selection else ()), *epochs)
    table = table_source.columns(tuple(dict.fromkeys(used)))
    row_numbers: Any = 0
    selection_notes: list[str] = []
    if selection:
        table, row_numbers, selection_notes = selection.select_rows(table, 0)
    numbers, unusable, unitless, is_given = {}, {}, {}, np.zeros(1, bool)
    for role, name in column_of.items():
        if role in ("name", "defining"):
            continue
        values, missing = table[name]
        unit = find_column_unit(name, units or {}, table_source)
        numbers[role] = parse_sexagesimal(role, name, np.asarray(values), missing, str(unit or ""))
        if numbers[role] is None:
            factor = unit_factor(name, unit, _UNITS_BY_ROLE[role]) if role in _UNITS_BY_ROLE else 1.0
            numbers[role] = as_floats_and_mask(name, np.asarray(values))[0] * factor
            unitless |= {role: name} if role in _UNITS_BY_ROLE and unit is None else {}
        bad = ~np.isfinite(numbers[role]) | (False if missing is None else np.asarray(missing))
        if role.endswith("error"):
            bad |= ~(numbers[role] > 0)
            if sigma is not None:
                numbers[role], is_given, bad = np.where(bad, sigma / MAS, numbers[role]), is_given | bad, False & bad
        if role == "ra_dec_corr":
            bad |= ~(numbers[role] ** 2 < RHO2_LIMIT)
            bad &= ~is_given
        unusable[f"{name} missing or not usable"] = bad
    is_unit_assumed = None if {"ra", column_of["ra"]} & {*(units or ())} else bool({"ra", "dec"} & {*unitless})
    doubt_notes = check_position_unit(numbers, is_unit_assumed, names=column_of)
    n = len(numbers["ra"])
    usable, notes = select_usable_rows(unusable, n, on_bad, row_numbers, (numbers["ra"], numbers["dec"]))
    # What a table lacks: errors, for which one is given then, and correlations.
    numbers = dict.fromkeys(("ra_error", "dec_error"), np.full(n, (sigma or 0.0) / MAS)) | numbers
    numbers = {"ra_dec_corr": np.zeros(n)} | numbers
    lon, lat = numbers["ra"][usable] * DEGREE, numbers["dec"][usable] * DEGREE
    errors = np.stack([numbers["ra_error"], numbers["dec_error"]])[:, usable]
    error_notes = _describe_errors(table_source.label, unitless, errors, sigma, np.count_nonzero(is_given), has_errors)
    notes = (*table_source.notes, *notes, *selection_notes, *error_notes, *doubt_notes, *frames.notes)
    names = None if "name" not in column_of else np.asarray(table[column_of["name"]][0])[usable]
    if names is not None and names.dtype.kind not in "iu":
        names = names.astype(str)
    if is_icrf and names is not None and not all(names):
        raise TableError(
            f"{table_source.label} has sources without a designation of the {designation.upper()}: name them by "
            f"{'iers' if designation == 'icrf' else 'icrf'}"
        )
    rho = np.where(is_given, 0.0, numbers["ra_dec_corr"])[usable]
    defining = np.asarray(table["defining"][0]).astype(str)[usable] == "D" if is_icrf else None
    years = np.unique(np.asarray(table[epochs[0]][0], float)) if epochs else np.zeros(0)
    epoch = float(years[0]) if len(years) == 1 and 1800 < years[0] < 2200 else None
    about: Any = {"name": names, "epoch": epoch, "defining": defining, "frame": frames.frame, "notes": notes}
    positions = Positions(lon, lat, errors * MAS, rho, **about)
    if table_source.covariance is None:
        return positions
    component_indices = np.arange(len(table_source.covariance)).reshape(2, -1)
    kept_indices = (component_indices[:, row_numbers] if selection else component_indices)[:, usable].ravel()
    return replace(positions, covariance=table_source.covariance[np.ix_(kept_indices, kept_indices)])


def _describe_errors(label, unitless, errors, sigma, n_filled, has_errors):
    """Notes on units that were assumed of columns, by role, on errors that were given, and on others [mas]."""
    label = Path(label).name  # pages and files do not say where a catalogue lies
    if sigma is not None:
        affected_sources = f"of the {n_filled} sources that have none" if has_errors else "of every source"
        yield f"{label}: {sigma:g} µas is the error {affected_sources} (as asked)"
    for unit in ("deg", "mas"):
        if names := [name for role, name in unitless.items() if _UNITS_BY_ROLE[role] == unit]:
            yield f"{label}: no unit in the table, so taken in {unit}: {', '.join(map(printable, names))}"
    median = float(np.median(errors)) if errors.size else 1.0
    if "ra_error" in unitless and not _PLAUSIBLE_ERRORS[0] <= median <= _PLAUSIBLE_ERRORS[1]:
        doubt = f"half of the errors are {'below' if median < 1 else 'above'} {median:.3g} mas"
        yield CodedNote(f"warning: {label}: {doubt}: in which unit are they (units=, --units)?", DOUBT)
