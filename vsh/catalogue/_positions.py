"""Positions with their errors, from the file of a reference frame or from a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vsh.catalogue._chosen import Chosen
from vsh.catalogue._columns import missing_column
from vsh.catalogue._icrf import open_icrf, read_icrf
from vsh.catalogue._units import unit_factor
from vsh.checks.arguments import positive
from vsh.checks.types import OnBad
from vsh.checks.validation import select_usable
from vsh.errors import TableError
from vsh.sky.positions import Positions
from vsh.units import DEGREE, MAS

#: Roles of columns, Gaia's names, and what a column without a unit is in.
_COLUMNS = {"ra": "deg", "dec": "deg", "ra_error": "mas", "dec_error": "mas"}
_OPTIONAL = ("ra_dec_corr", "name")
_NAMES = ("source_id", "name", "designation")


def read_positions(
    source: Any,
    columns: Mapping[str, str] | str | None = None,
    *,
    sigma: float | None = None,
    on_bad: OnBad = "raise",
    frame: str = "icrs",
    designation: str = "iers",
    where: str | None = None,
    format: str | None = None,
) -> Positions:
    """Read positions of a reference frame.

    Parameters
    ----------
    source : path or table
        ICRF2 or ICRF3 as the IERS hands them round, or a table: ra and dec [deg], ra_error (of α cos δ) and dec_error [mas],
        ra_dec_corr, and names where they are.
    columns : dict of str to str, or "gaia", "icrf", optional
        Other names of these columns, by role; "name" is source_id, name or designation unless given.
    sigma : float, optional
        One error for all, in place of the table's; needed where it has none. [µas]
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used.
    frame : str
        Of the positions of a table.
    designation : {"iers", "icrf"}
        Which names of ICRF's sources.
    where : str, optional
        A condition on a table's columns, as for `read_field`; on those of ICRF with `format="icrf"`.
    format : str, optional
        Of a file, as for `read_field`.

    Raises
    ------
    TableError
        If the file cannot be read, or a column is missing.
    FieldError
        If rows cannot be used.
    """
    columns = {"names": columns} if isinstance(columns, str) else dict(columns or {})
    known = columns.pop("names", "gaia")
    if known not in ("gaia", "icrf"):
        raise TableError(f"columns: no set of names of positions is called {known!r}; there are gaia, icrf")
    listed = format == "icrf" or (format is None and _is_icrf(source))
    if listed and where is None and not columns:
        found = read_icrf(source, designation)
        return found if sigma is None else _with_sigma(found, sigma)
    wrong = [str(role) for role in columns if role not in (*_COLUMNS, *_OPTIONAL)]
    if wrong:
        raise TableError(
            f"columns: nothing of positions is called {', '.join(wrong)}; there are {', '.join((*_COLUMNS, *_OPTIONAL))}"
        )
    opened = open_icrf(source, "icrf" if listed else format)
    if listed or known == "icrf":
        columns = {"name": designation} | columns
    roles = {role: columns.get(role, role) for role in (*_COLUMNS, *_OPTIONAL)}
    if "name" not in columns:
        roles["name"] = next((name for name in _NAMES if name in opened.names), "name")
    if sigma is not None:
        roles.pop("ra_error"), roles.pop("dec_error"), roles.pop("ra_dec_corr")
    for role in _COLUMNS:
        if role in roles and roles[role] not in opened.names:
            also = "; or one error for all, sigma= (--position-error)" if role.endswith("error") else ""
            raise TableError(missing_column(roles[role], opened) + also)
    roles = {role: name for role, name in roles.items() if name in opened.names}
    clause = None if where is None else Chosen(where, opened)
    table = opened.columns(tuple(dict.fromkeys([*roles.values(), *(clause.names if clause else ())])))
    rows: Any = 0
    if clause:
        table, rows, chosen = clause.of(table, 0)
    numbers, bad = {}, {}
    for role, name in roles.items():
        if role == "name":
            continue
        values, missing = table[name]
        factor = unit_factor(name, opened.units.get(name), _COLUMNS[role]) if role in _COLUMNS else 1.0
        numbers[role] = np.asarray(values, float) * factor
        lost = ~np.isfinite(numbers[role]) | (False if missing is None else np.asarray(missing))
        if role.endswith("error"):
            lost |= ~(numbers[role] > 0)
        bad[f"{name} missing or not usable"] = lost
    unusable = {reason: mask for reason, mask in bad.items() if mask.any()}
    keep, notes = select_usable(unusable, len(numbers["ra"]), on_bad, rows, (numbers["ra"], numbers["dec"]))
    notes = (*notes, *chosen) if clause else notes
    lon, lat = numbers["ra"][keep] * DEGREE, numbers["dec"][keep] * DEGREE
    errors = np.stack([numbers["ra_error"], numbers["dec_error"]])[:, keep] * MAS if sigma is None else np.full((2, lon.size), positive("sigma", sigma))  # fmt: skip
    names = None if "name" not in roles else np.asarray(table[roles["name"]][0])[keep]
    if names is not None and names.dtype.kind not in "iu":
        names = names.astype(str)
    rho = numbers["ra_dec_corr"][keep] if "ra_dec_corr" in numbers else np.zeros(lon.size)
    return Positions(lon, lat, errors, rho, name=names, frame=frame, notes=(*opened.notes, *notes))


def _with_sigma(found, sigma):
    return replace(found, sigma=np.full((2, len(found)), positive("sigma", sigma)), rho=np.zeros(len(found)))


def _is_icrf(source):
    """Whether a path is a file of ICRF's fixed columns."""
    if not isinstance(source, str) and not hasattr(source, "__fspath__"):
        return False
    if not str(source).endswith((".txt", ".dat")):
        return False
    try:
        with open(source, encoding="utf-8", errors="replace") as file:
            return any(line.startswith("ICRF J") for line in file)
    except OSError:
        return False
