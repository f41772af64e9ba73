"""CPU time from 10³ to 10⁷ sources beside its limits, and a Parquet folder of 10⁷ in little memory.

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


def by_size(lmax=5):
    """CPU seconds from 10³ to 10⁷ sources: the fit beside the raw transforms, the fit to quote, a file beside a bare read."""
    import pyarrow.parquet
    from fits import least_cpu, raw_transforms, recommended, this_project

    from vsh.io.catalogue import read_field

    print(f"CPU seconds, degree {lmax}")
    print(
        f"{'sources':>9} {'transforms':>11} {'fit_field':>10} {'recommended':>12} {'bare read':>10} {'read_field':>11}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for n in (1000, 10_000, 100_000, 1_000_000, 10_000_000):
            field, path, runs = synthetic(n), Path(folder) / "one.parquet", 3 if n < 10**7 else 1
            times = [least_cpu(code, field, lmax, runs=runs) for code in (raw_transforms, this_project, recommended)]
            write_rows(path, n, 0)
            times += [least_cpu(read, path, runs=3) for read in (pyarrow.parquet.read_table, read_field)]
            print(
                f"{n:9d} {times[0]:11.4f} {times[1]:10.4f} {times[2]:12.4f} {times[3]:10.4f} {times[4]:11.4f}",
                flush=True,
            )


def write_folder(folder, files=20, rows=500_000):
    """10⁷ sources in Gaia's columns."""
    for i in range(files):
        write_rows(folder / f"part{i:03d}.parquet", rows, i)


def write_rows(path, rows, seed):
    field = synthetic(rows, seed=seed)
    columns = {"source_id": np.arange(rows) + seed * rows, "ra": np.degrees(field.lon), "dec": np.degrees(field.lat)}
    columns |= {"pmra": field.motion[0] / 1000, "pmdec": field.motion[1] / 1000}
    columns |= {"pmra_error": field.sigma[0] / 1000, "pmdec_error": field.sigma[1] / 1000}
    path.unlink(missing_ok=True)
    tables.write_columns(path, columns | {"pmra_pmdec_corr": field.rho})


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
        by_size()
        with tempfile.TemporaryDirectory() as folder:
            write_folder(Path(folder))
            for workers in ([], ["2"]):
                subprocess.run([sys.executable, __file__, folder, *workers], check=True)
