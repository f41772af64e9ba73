"""Time per source from 10⁵ to 10⁷ sources, and a Parquet folder of 10⁷ in little memory.

python benchmarks/scaling.py [FOLDER [WORKERS]]
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
from vsh import Modes
from vsh.io import tables


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
        tables.write_columns(folder / f"part{i:03d}.parquet", columns | {"pmra_pmdec_corr": field.rho})


def stream(folder, lmax=10, workers=None):
    """Fit the folder in one pass; say how long, how much memory, and what 10⁹ sources would take of each."""
    from vsh.io.catalogue import parts

    start, before = time.perf_counter(), time.process_time()
    sky = parts(folder, workers=workers)
    solution = fit.solve(fit.normal_equations(sky, Modes(lmax)))
    seconds, cpu = time.perf_counter() - start, time.process_time() - before
    n = solution.n_data // 2
    usage = [resource.getrusage(who).ru_maxrss / 2**20 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    size = sum(path.stat().st_size for path in Path(folder).rglob("*.parquet"))
    print(f"{n} sources in {len(sky)} files, degree {lmax}, {sky!r}: {seconds:.1f} s ({seconds / n * 1e9:.0f} ns a source), "
          f"peak memory {usage[0]:.2f} GiB here, {usage[1]:.2f} GiB in the largest worker")  # fmt: skip
    if workers is None:
        moments = (3 * (2 * lmax + 1) * (4 * lmax + 1) + 2 * (lmax + 1) * (2 * lmax + 1)) * 16
        print(f"{cpu / n * 1e9:.0f} ns of CPU a source: 10⁹ sources in {cpu / n * 1e9 / 60:.1f} core-minutes, from "
              f"{7 * 8} GB of seven columns, with {moments * 2000 / 1e9:.2g} GB of moments of 2000 parts over the network "
              f"(these files: {size / 1e9:.2g} GB)")  # fmt: skip


if __name__ == "__main__":
    if len(sys.argv) > 1:
        stream(Path(sys.argv[1]), workers=int(sys.argv[2]) if len(sys.argv) > 2 else None)
    else:
        per_source()
        with tempfile.TemporaryDirectory() as folder:
            write_folder(Path(folder))
            for workers in ([], ["2"]):
                subprocess.run([sys.executable, __file__, folder, *workers], check=True)
