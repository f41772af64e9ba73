"""What a fit is given: a field, parts of one, or what a field can be read from."""

from pathlib import Path
from typing import Any

from vsh.field import Weighed
from vsh.io.parts import Parts
from vsh.tools.errors import FieldError


def is_readable(value: Any) -> bool:
    """Whether a field can be read from it: a path, or a table with columns by their names."""
    return isinstance(value, str | Path) or any(
        hasattr(value, each) for each in ("colnames", "columns", "column_names")
    )


def as_field(name: str, value: Any) -> Any:
    """A field or parts as they are; a path or a table in memory, read.

    name : str
        The argument's, for messages.
    value : Field, Parts, ScalarField, path or table
        A table is anything with columns by their names: astropy, pandas, polars, Arrow.
    """
    if isinstance(value, Weighed | Parts):
        return value
    if is_readable(value):
        from vsh.io.catalogue._read import read_field

        return read_field(value)
    raise FieldError(
        f"{name} is a Field, parts of one (vsh.io.catalogue.parts), a path or a table of a catalogue, not "
        f"{type(value).__name__}"
    )
