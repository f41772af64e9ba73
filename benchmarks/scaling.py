"""Time per source from 10⁵ to 10⁷ sources, and a Parquet folder of 10⁷ in little memory.

python benchmarks/scaling.py [FOLDER]
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from catalogue import synthetic

import fit
from vsh import Modes, tables


def per_source(lmax=10, runs=5):
    """Time of a fit divided by the number of sources, as that grows."""
    print(f"degree {lmax}, the whole fit")
    print(f"{'sources':>9} {'seconds':>9} {'ns/source':>10}")
    for n in (100_000, 300_000, 1_000_000, 3_000_000, 10_000_000):
        field = synthetic(n)
        times = []
        for _ in range(runs + 1):
            start = time.perf_counter()
            fit.fit_field(field, lmax)
            times.append(time.perf_counter() - start)
        median = np.median(times[1:])
        print(f"{n:9d} {median:9.3f} {median / n * 1e9:10.1f}", flush=True)


def write_folder(folder, files=20, rows=500_000):
    """10⁷ sources in Gaia's columns."""
    for i in range(files):
        field = synthetic(rows, seed=i)
        columns = {"source_id": np.arange(rows) + i * rows, "ra": np.degrees(field.lon), "dec": np.degrees(field.lat)}
        columns |= {"pmra": field.motion[0] / 1000, "pmdec": field.motion[1] / 1000}
        columns |= {"pmra_error": field.sigma[0] / 1000, "pmdec_error": field.sigma[1] / 1000}
        tables.write(folder / f"part{i:02d}.parquet", columns | {"pmra_pmdec_corr": field.rho})


def stream(folder, lmax=10):
    """Fit the folder in one pass; say how long and how much memory."""
    from vsh.catalogue import iter_fields

    start = time.perf_counter()
    solution = fit.solve(fit.normal_equations(iter_fields(folder, rows=500_000), Modes(lmax)))
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"Parquet folder: {solution.n_data // 2} sources, degree {lmax}, {seconds:.1f} s, peak memory {peak:.2f} GiB")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        stream(Path(sys.argv[1]))
    else:
        per_source()
        with tempfile.TemporaryDirectory() as folder:
            write_folder(Path(folder))
            subprocess.run([sys.executable, __file__, folder], check=True)
