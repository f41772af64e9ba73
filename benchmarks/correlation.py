"""Correlation map, influence map and leakage of 1.6 million positions, timed."""

import time

import numpy as np

import sim
from fit.correlation import correlation_matrices, influence_map, leakage
from vsh import Field


def main(n=1_600_000):
    field = Field.from_positions(sim.quasars(n, 1, "igql"), 300.0)
    total = time.perf_counter()
    for words, call in (
        ("correlation matrices, degree 10", lambda: correlation_matrices(field, 10)),
        ("influence map, degree 10, nside 32", lambda: influence_map(field, 10, ("omega_y", "a_x"), 32)),
        ("leakage of degrees 11 to 20", lambda: leakage(field, 10, 20)),
    ):
        begin = time.perf_counter()
        found = call()
        print(f"{words}: {time.perf_counter() - begin:.2f} s ({getattr(found, 'shape', found)})")
    print(f"together: {time.perf_counter() - total:.2f} s for {n} positions; numpy {np.__version__}")


if __name__ == "__main__":
    main()
