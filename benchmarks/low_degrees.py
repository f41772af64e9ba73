"""Degrees 1 and 3 of a million sources, beside vsh-tools 1.0.0, in one run.

python benchmarks/low_degrees.py
"""

import sys
import time

import numpy as np
import vsh_tools
from catalogue import synthetic

import fit


def seconds(function, *arguments):
    """How long a call takes."""
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


def theirs(field, lmax):
    """The same fit by vsh-tools, in blocks, without keeping residuals."""
    s1, s2 = field.sigma
    vsh_tools.fit_vsh(
        field.lon, field.lat, *field.motion, lmax, method="chunked", sigma_ra=s1, sigma_dec=s2, rho=field.rho,
        store_residuals=False,
    )  # fmt: skip


def main(n=1_000_000, runs=5):
    field = synthetic(n)
    print(f"{n} sources with correlations; median (least) of {runs} runs, in seconds")
    print(f"{'degree':>6} {'vsh-tools':>18} {'this project':>18} {'ratio':>7}")
    for lmax in (1, 3):
        times = np.array([[seconds(f, field, lmax) for f in (theirs, fit.fit_field)] for _ in range(runs)])
        cells = (f"{np.median(t):9.3f} ({min(t):.3f})" for t in times.T)
        print(f"{lmax:6d} {' '.join(cell.rjust(18) for cell in cells)} {np.median(times[:, 0] / times[:, 1]):7.1f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
