"""What a user waits for: the whole of `vsh-fit` beside reading and fitting alone, and 500 draws of a bootstrap.

    python benchmarks/command.py

1.6 million rows of FITS in the archive's columns, degree 10; every time is the least of three, in one run.
"""

import contextlib
import io
import tempfile
import time
from pathlib import Path

import numpy as np
from astropy.io import fits
from astropy.table import Table

import fit
import sim
from fit.commands.fit import main
from fit.resample import bootstrap
from vsh import Field

NAMES = ["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr"]


def least(function, runs=3):
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        found = function()
        times.append(time.perf_counter() - start)
    return min(times), found


def whole_command(path):
    with contextlib.redirect_stdout(io.StringIO()):
        assert main([str(path), "--lmax", "10"]) == 0


def seven_columns(path):
    table = Table.read(path)
    return [np.array(table[name], float) for name in NAMES]


def seven_views(path):
    with fits.open(path) as units:
        return [np.array(units[1].data[name], float) for name in NAMES]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "crf3.fits"
        sim.crf3(1).write(path)
        command, _ = least(lambda: whole_command(path))
        table, columns = least(lambda: seven_columns(path))
        views, _ = least(lambda: seven_views(path))
        field = Field.from_columns(*columns)
        equations, _ = least(lambda: fit.normal_equations(field, 10))
        print(f"vsh-fit {command:.2f} s; seven columns by Table.read {table:.3f} s, by fits.open {views:.3f} s; normal equations "
              f"{equations:.3f} s; the command takes {command / (table + equations):.2f} × (Table.read) or "
              f"{command / (views + equations):.2f} × (fits.open) of both")  # fmt: skip
        for lmax in (3, 10):
            seconds, found = least(lambda lmax=lmax: bootstrap(field, lmax, 500, 1, progress=False), 1)
            print(f"500 draws of {len(field)} sources at degree {lmax}: {seconds:.1f} s ({found.method})")
