"""CPU time a source of a catalogue in parts, beside a loop over Arrow's batches written by hand.

    python benchmarks/parts.py FOLDER [LMAX]
    python benchmarks/parts.py s3://BUCKET/FOLDER [LMAX]

FOLDER holds Parquet files in Gaia's columns, or a catalogue in HATS format; where LSDB is installed and FOLDER is one,
it is read by LSDB too. Every way is run three times, turn by turn; the least is taken. At an address the harmonics are
fitted beside a read of the same columns that makes nothing of them, with all cores.
"""

import os
import sys
import time
from contextlib import nullcontext

import numpy as np
import pyarrow.dataset
import pyarrow.fs

from fit import Moments
from vsh import Field
from vsh.io.catalogue import parts
from vsh.io.tables import files_of, is_address
from vsh.tools.parallel import limit_threads

NAMES = ["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr"]


def by_hand(folder, lmax):
    total = 0
    dataset = pyarrow.dataset.dataset([str(path) for path in files_of(folder)])
    for batch in dataset.to_batches(columns=NAMES, batch_size=2**17):
        if batch.num_rows:
            columns = [np.asarray(batch.column(name)) for name in NAMES]
            total = total + Moments.of(Field.from_columns(*columns), lmax)
    return total


def bare_read(address, lmax):
    """Read the columns, and make nothing of them."""
    filesystem, path = pyarrow.fs.FileSystem.from_uri(address)
    dataset = pyarrow.dataset.dataset(path, filesystem=filesystem, format="parquet")
    return sum(batch.num_rows for batch in dataset.to_batches(columns=NAMES, batch_size=2**17))


def by_files(folder, lmax):
    return Moments.of(parts(folder), lmax)


def by_lsdb(folder, lmax):
    import lsdb

    return Moments.of(parts(lsdb.open_catalog(folder)), lmax)


def by_dask(folder, lmax):
    import dask.dataframe

    paths = [str(path) for path in files_of(folder)]
    return Moments.of(parts(dask.dataframe.read_parquet(paths)), lmax)


def main(folder, lmax=10):
    ways = {"a loop by hand": by_hand, "files": by_files, "Dask DataFrame": by_dask}
    if is_address(folder):
        ways = {"a bare read": bare_read, "files": by_files}
    if os.path.exists(os.path.join(folder, "hats.properties")):
        ways["LSDB"] = by_lsdb
    best, wall, sums = {}, {}, {}
    with nullcontext() if is_address(folder) else limit_threads(1):
        for _ in range(3):
            for way, function in ways.items():
                start, clock = time.process_time(), time.perf_counter()
                try:
                    sums[way] = function(folder, int(lmax))
                except ImportError as error:
                    print(f"{way}: {error}")
                    continue
                n = sums[way] if isinstance(sums[way], int) else sums[way].n_data / 2
                best[way] = min(best.get(way, np.inf), (time.process_time() - start) / n * 1e9)
                wall[way] = min(wall.get(way, np.inf), (time.perf_counter() - clock) / n * 1e9)
    first, *_ = ways
    for way, cpu in best.items():
        print(f"{way:16} {cpu:7.0f} ns of CPU a source, {cpu / best[first]:.2f} × {first}; "
              f"{wall[way]:5.0f} ns by the clock, {wall[way] / wall[first]:.2f} ×", end="")  # fmt: skip
        if first == "a loop by hand":
            weights = sums[first].weights
            print(f"; differs by {np.abs(sums[way].weights - weights).max() / np.abs(weights).max():.1e}", end="")
        print()
    print(f"{n:.0f} sources")


if __name__ == "__main__":
    main(*sys.argv[1:])
