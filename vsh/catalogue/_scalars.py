"""Numbers of sources, and their errors, from a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh import tables
from vsh.catalogue._columns import frame_of, missing_column
from vsh.catalogue._units import parse_unit, unit_factor
from vsh.checks.types import OnBad
from vsh.errors import TableError
from vsh.scalars import ScalarField


def read_scalars(
    source: Any,
    value: str = "parallax",
    error: str | None = None,
    *,
    ra: str = "ra",
    dec: str = "dec",
    name: str | None = None,
    unit: str | None = None,
    on_bad: OnBad = "raise",
    frame: str | None = None,
) -> ScalarField:
    """Read a scalar field from a table: parallaxes of quasars, unless another column is asked for.

    Parameters
    ----------
    source : path, table, dict
        As for `vsh.catalogue.read_field`.
    value, error : str
        Columns of the numbers and of their standard errors; "parallax_error" of "parallax" unless given.
    ra, dec : str
        Columns of positions in the axes of `frame`; in degrees where the table says nothing.
    name : str, optional
        Column of names.
    unit : str, optional
        To convert to, "uas" say; that of the table unless given, and mas for Gaia's parallaxes without one.
    on_bad : {"raise", "drop"}
        What to do about rows that cannot be used; the field's notes count them.
    frame : str, optional
        "icrs", "galactic" or "ecliptic"; that of a field that was written, or ICRS, unless given.

    Raises
    ------
    TableError
        If a column is missing, or its unit is another kind.
    FieldError
        If a column holds no numbers, or rows cannot be used.

    Examples
    --------
    >>> read_scalars({"ra": [10.0], "dec": [-20.0], "parallax": [-0.02], "parallax_error": [0.1]}, unit="uas").values
    array([-20.])
    """
    opened = tables.open_table(source)
    error = error or f"{value}_error"
    wanted = [ra, dec, value, error] + ([name] if name else [])
    for column in wanted:
        if column not in opened.names:
            raise TableError(missing_column(column, opened))
    found, notes = opened.columns(tuple(wanted)), []
    units = {column: parse_unit(opened.units.get(column) or "") for column in (value, error)}
    for column in (value, error):
        if units[column].is_unity() and column in ("parallax", "parallax_error"):
            units[column] = parse_unit("mas")
            notes.append(f"no unit in the table, so taken in mas: {column}")
    target = parse_unit(unit) if unit else units[value]
    factors = {}
    for column in (value, error):
        try:
            factors[column] = units[column].to(target)
        except ValueError as wrong:  # astropy's UnitConversionError is one
            raise TableError(f"column {column!r} cannot be converted to {target}: {wrong}") from None
    for column in (ra, dec):
        factors[column] = unit_factor(column, opened.units.get(column), "deg")
    numbers = {
        column: np.ma.array(
            np.asarray(found[column][0], float) * factor, mask=False if found[column][1] is None else found[column][1]
        )
        for column, factor in factors.items()
    }
    return ScalarField.from_columns(
        numbers[ra], numbers[dec], numbers[value], numbers[error], unit=target.to_string(),
        name=None if name is None else found[name][0], frame=frame_of({}, frame, opened.meta), on_bad=on_bad, notes=notes,
    )  # fmt: skip
