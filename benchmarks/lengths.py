"""How often limits and intervals of a length hold, for vectors whose three errors differ.

    python benchmarks/lengths.py [DRAWS]

A row for each set of errors and each axis that the true vector lies along; in each column "95 % limit / 68 % interval" for
a true length of 0, 1, 2, 3 and 5 errors of that axis.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from vsh.length import length_interval, length_limits

LENGTHS = (0, 1, 2, 3, 5)
#: Errors, and the axes that differ.
CELLS = [
    (errors, axis)
    for errors in ((1, 1, 2), (1, 1, 4), (1, 4, 4), (1, 1, 8))
    for axis in range(3)
    if not axis or errors[axis] != errors[axis - 1]
]


def coverage(errors, axis, length, n, rng):
    """Shares of the limits, and of the intervals, that hold a true length."""
    covariance = np.diag(np.square(errors)).astype(float)
    values = length * np.eye(3)[axis] + errors * rng.normal(size=(n, 3))
    limits = length_limits(values, np.broadcast_to(covariance, (n, 3, 3)))
    low, high = np.transpose([length_interval(value, covariance) for value in values])
    return np.mean(limits >= length), np.mean((low <= length) & (length <= high))


def row(cell, n):
    """One line of the table."""
    errors, axis = cell
    rng = np.random.default_rng(sum(errors) + axis)
    shares = [coverage(errors, axis, each * errors[axis], n, rng) for each in LENGTHS]
    return f"{' : '.join(map(str, errors))}    {'xyz'[axis]}  " + " ".join(
        f"{one:6.3f}/{two:.3f}" for one, two in shares
    )


def main(n=1000):
    print("errors       axis", *(f"{f'S/N {each}':>12}" for each in LENGTHS))
    with ProcessPoolExecutor() as pool:
        for line in pool.map(partial(row, n=n), CELLS):
            print(line, flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
