"""Catalogues: from tables to fields and back, whole or in parts; ICRF's positions, two catalogues matched."""

from vsh.catalogue._columns import GAIA, Columns, as_columns, missing_column
from vsh.catalogue._icrf import open_icrf, read_icrf
from vsh.catalogue._match import Counterparts, counterparts, match
from vsh.catalogue._parts import parts
from vsh.catalogue._positions import read_positions
from vsh.catalogue._read import iter_fields, read_field, write_field
from vsh.catalogue._scalars import read_scalars
from vsh.catalogue._sources import read_sources
from vsh.catalogue._truth import truth_of
from vsh.catalogue._units import unit_factor

__all__ = [
    "GAIA",
    "Columns",
    "Counterparts",
    "iter_fields",
    "match",
    "parts",
    "read_field",
    "read_icrf",
    "read_positions",
    "read_scalars",
    "write_field",
]
