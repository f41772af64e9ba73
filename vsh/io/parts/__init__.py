"""Sources in parts: files, partitions on a cluster, blocks of a stream, and sums over them."""

from vsh.io.parts._engines import Dask, Engine, InProcess, Processes, SumTree, add_sums, delayed_partitions, is_delayed
from vsh.io.parts._parts import (
    DISTANCES,
    OPTIONAL,
    Parts,
    apply_step,
    as_parts,
    check_fields_or_parts,
    median,
    sample_of,
    single_frame,
    weighted_quantiles,
)

__all__ = ["Dask", "Parts", "Processes"]
