"""Sources in parts: files, partitions on a cluster, blocks of a stream, and sums over them."""

from vsh.io.parts._engines import Dask, Engine, InProcess, Processes, SumTree, add_sums, delay_partitions, is_delayed
from vsh.io.parts._parts import (
    DISTANCES,
    OPTIONAL,
    Parts,
    apply_step,
    as_parts,
    check_fields_or_parts,
    find_single_frame,
    median,
    sample_of,
    weighted_quantiles,
)

__all__ = ["Dask", "Parts", "Processes"]
