"""Catalogues: from tables to fields and back, whole or in parts; ICRF's positions, two catalogues matched."""

from vsh.io.catalogue._columns import GAIA, Columns, as_columns, missing_column, unit_factor
from vsh.io.catalogue._match import Counterparts, counterparts, match, open_icrf, read_icrf, read_positions
from vsh.io.catalogue._parts import parts
from vsh.io.catalogue._read import iter_fields, read_field, read_scalars, read_sources, truth_of, write_field

__all__ = [
    "GAIA",
    "Columns",
    "Counterparts",
    "iter_fields",
    "match",
    "parts",
    "read_field",
    "read_icrf",
    "read_scalars",
    "write_field",
]
