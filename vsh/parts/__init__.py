"""Sources in parts: files, partitions on a cluster, blocks of a stream, and sums over them."""

from vsh.parts._add import Tree, added
from vsh.parts._checks import fields_or_parts
from vsh.parts._dask import Dask, is_delayed
from vsh.parts._engines import Engine, Here, Processes
from vsh.parts._parts import DISTANCES, OPTIONAL, Parts, as_parts
from vsh.parts._quantiles import median, weighted_quantiles
from vsh.parts._sample import sample_of

__all__ = [
    "Dask",
    "Engine",
    "Parts",
    "Processes",
    "as_parts",
]
