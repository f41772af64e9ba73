"""Catalogues: from tables to fields and back, whole or in parts; ICRF's positions, two catalogues matched."""

from vsh.io.catalogue._columns import as_columns, as_doubles, check_position_unit
from vsh.io.catalogue._frames import find_frames
from vsh.io.catalogue._match import MatchResult, counterparts, match, read_icrf, read_positions, rename_sources
from vsh.io.catalogue._names import GAIA, NAMED, Columns, has_field_columns
from vsh.io.catalogue._parts import parts
from vsh.io.catalogue._read import (
    as_field,
    has_epochs,
    is_map,
    is_readable,
    read_columns,
    read_field,
    read_scalars,
    read_sources,
    stream_columns,
    stream_fields,
    truth_of,
)

__all__ = [
    "GAIA",
    "Columns",
    "MatchResult",
    "match",
    "parts",
    "read_columns",
    "read_field",
    "read_icrf",
    "read_scalars",
]
