"""Catalogues of which only positions, and perhaps errors, are wanted."""

from vsh import tables
from vsh.catalogue import Columns, as_columns, read_field
from vsh.errors import TableError

_MOTIONS = ("pmra", "pmdec")
_ERRORS = ("pmra_error", "pmdec_error")


def read_sources(source, columns=None, units=None, on_bad="raise", sigma=None):
    """Read positions and errors; what the table lacks of motions is zero.

    Parameters
    ----------
    source, columns, units, on_bad
        As for `vsh.catalogue.read_field`.
    sigma : float, optional
        One error for all, in place of the table's. [µas/yr]

    Returns
    -------
    Field
        Its notes say what was put in: a table without errors is given 1 mas/yr for every source.

    Raises
    ------
    TableError, FieldError
        As `vsh.catalogue.read_field` does.
    """
    table = tables.as_table(source)
    wanted = as_columns(columns)
    for role in ("ra", "dec"):
        if getattr(wanted, role) not in table.colnames:
            raise TableError(
                f"no column {getattr(wanted, role)!r} for {role}: name it, columns={{{role!r}: ...}} (--columns {role}=NAME). "
                f"The table has {', '.join(table.colnames)}"
            )
    absent = {role for role in (*_MOTIONS, *_ERRORS) if getattr(wanted, role) not in table.colnames}
    for pair in (_MOTIONS, _ERRORS):  # one of two is a slip of the pen, not a table without them
        if len(absent & set(pair)) == 1 and not (pair is _ERRORS and sigma is not None):
            return read_field(table, wanted, units, on_bad)  # which says what is missing
    replaced = {role for role in _MOTIONS if role in absent}
    if sigma is not None or absent & set(_ERRORS):
        replaced |= set(_ERRORS)
    if not replaced:
        return read_field(table, wanted, units, on_bad)
    table = table.copy(copy_data=False)
    names = {}
    for role in replaced:
        names[role] = f"assumed {role}"
        value = 0.0 if role in _MOTIONS else (1000.0 if sigma is None else float(sigma))
        table[names[role]] = [value] * len(table)
        table[names[role]].unit = "uas / yr"
    changed = {role: getattr(wanted, role) for role in Columns.__dataclass_fields__} | names
    field = read_field(table, Columns(**changed), units, on_bad)
    if set(_ERRORS) & replaced:
        what = "as asked" if sigma is not None else "no errors in the table: all sources weigh the same"
        field = field.add_note(
            f"errors of {1000.0 if sigma is None else float(sigma):g} µas/yr for every source ({what})"
        )
    return field
