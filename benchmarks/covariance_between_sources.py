"""Errors of a rotation where all sources of a catalogue share an error of its axes, with and without its covariance.

    python benchmarks/covariance_between_sources.py [SKIES]

120 sources with errors of 30 to 60 µas and a common rotation of 80 µas about each axis, as solutions in SINEX have them,
against a catalogue with errors of 10 µas: rms pull of the rotation's components, and how many lie within 1 and 1.96 errors.
"""

import sys
from dataclasses import replace

import numpy as np

import sim
from fit.frames.compare import compare_catalogues
from vsh.sky.frames import Positions
from vsh.tools.units import UAS


def catalogues(rng, n=120):
    """Two catalogues of one sky, the first with the covariance of its sources."""
    lon, lat = sim.uniform_sky(n, rng)
    rotations = np.array([sim.spin(axis)(lon, lat).ravel() for axis in 80.0 * np.eye(3)])
    sigma = rng.uniform(30, 60, (2, n))
    offsets = rng.normal(size=3) @ rotations + sigma.ravel() * rng.normal(size=2 * n)
    east, north = offsets.reshape(2, n) * UAS
    covariance = rotations.T @ rotations + np.diag(sigma.ravel() ** 2)
    own, name = np.sqrt(np.diag(covariance)).reshape(2, n), np.arange(n)
    one = Positions(lon + east / np.cos(lat), lat + north, own, name=name, covariance=covariance)
    return one, Positions(lon, lat, np.full((2, n), 10.0), name=name)


def main(n_skies=200):
    """Print a row for each way."""
    rows = {"with the covariance": [], "with the covariance and the floor": [], "errors of each source alone": []}
    for seed in range(n_skies):
        one, two = catalogues(np.random.default_rng(seed))
        ways = ((one, False), (one, True), (replace(one, covariance=None), False))
        for pulls, (catalogue, floor) in zip(rows.values(), ways, strict=True):
            spin = compare_catalogues(catalogue, two, 1, floor=floor)[0].best.spin
            pulls.append(np.abs(spin.value / spin.sigma))
    for name, pulls in rows.items():
        x = np.array(pulls)
        print(f"{name:34} {np.sqrt(np.mean(x**2)):5.2f}   {np.mean(x < 1):.3f} {np.mean(x < 1.96):.3f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
