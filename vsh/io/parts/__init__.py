"""Sources in parts: files, partitions on a cluster, blocks of a stream, and sums over them."""

from vsh.io.parts._engines import Dask, Engine, InProcess, Processes, Tree, added, delayed_of, is_delayed
from vsh.io.parts._parts import (
    DISTANCES,
    OPTIONAL,
    Parts,
    applied,
    as_parts,
    field_or_fields,
    fields_or_parts,
    median,
    sample_of,
    weighted_quantiles,
)

__all__ = ["Dask", "Parts", "Processes"]
