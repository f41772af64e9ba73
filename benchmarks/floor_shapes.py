"""The floor of two shapes on skies of sources: does it hold, and what does it cost where nothing is there?

    python benchmarks/floor_shapes.py [SKIES] [WORDS]

A row for each case whose name holds the words: pulls of spin and acceleration by the floor, how often one, 1.96 and three
errors hold, the quoted error, and the same for a plain fit. 2000 sources a sky with errors so small that they stand for
1.2 million quasars; systematics to degree 24, degree 1 among them.
"""

import sys

import numpy as np

import fit
import sim
from fit.background import SHAPES, floor
from vsh import Coefficients, DegeneracyError, Field, Modes
from vsh.models.covariance import VASILIEV_BAUMGARDT_2021, Spectrum

HIGHEST, SIGMA = 24, np.sqrt(2.2 / (4 * np.pi))
ODD, EVEN = Spectrum.odd(), Spectrum.even()
TRUTHS = {
    "none": None,
    "flat": 20.0 * ODD + 5.0 * EVEN,
    "lindegren": SHAPES["gaia"],
    "vasiliev": Spectrum.from_covariance(VASILIEV_BAUMGARDT_2021),
    "mixture": 0.5 * (10.0 * ODD + 2.5 * EVEN) + 0.5 * SHAPES["gaia"],
}


def sky(kind, n, rng):
    """Directions: outside the plane, one half of the sky, in clumps, or anywhere."""
    if kind == "plane":
        return sim.plane_avoiding_sky(n, rng)
    if kind == "half":
        lon, lat = sim.uniform_sky(4 * n, rng)
        keep = np.flatnonzero(lat > 0)[:n]
        return lon[keep], lat[keep]
    if kind == "clumps":
        lon, lat = sim.uniform_sky(30, rng)
        at = rng.integers(30, size=n)
        east, north = 0.1 * rng.normal(size=(2, n))
        return (lon[at] + east / np.cos(lat[at])) % (2 * np.pi), np.clip(lat[at] + north, -1.57, 1.57)
    return sim.uniform_sky(n, rng)


def one(truth, lmax, kind, n, robust, seed):
    rng = np.random.default_rng([11, seed])
    lon, lat = sky(kind, n, rng)
    sigma = np.full((2, n), SIGMA * np.sqrt(n))
    motion = sigma * rng.normal(size=(2, n))
    if TRUTHS[truth] is not None:
        variances = TRUTHS[truth].variances(Modes(HIGHEST))
        motion = motion + systematics(variances, lon, lat, rng)
    if robust:
        bad = rng.random(n) < 0.05
        motion[:, bad] += 10 * sigma[:, bad] * rng.standard_t(2, size=(2, bad.sum()))
    field = Field(lon, lat, motion, sigma)
    normal = fit.robust.student_t(field, lmax).solution if robust else fit.normal_equations(field, lmax)
    plain = normal if robust else fit.solve(normal)
    with_floor = fit.solve(fit.background.equations_of(normal), floor=floor(normal))
    first = np.flatnonzero(Modes(lmax).degrees == 1)
    return [np.stack([each.values[first], each.sigma[first]]) for each in (with_floor, plain)]


def systematics(variances, lon, lat, rng):
    modes = Modes(HIGHEST)
    return Coefficients(modes, rng.normal(size=len(modes)) * np.sqrt(variances)).at(lon, lat)


CASES = [(truth, lmax, "plane", 2000, False) for truth in TRUTHS for lmax in (3, 5, 7, 10)]
CASES += [(truth, 5, kind, n, robust) for truth in ("none", "flat", "lindegren") for kind, n, robust in (
    ("plane", 2000, True), ("half", 2000, False), ("clumps", 2000, False), ("uniform", 60, False))]  # fmt: skip


def main(skies=200, words=""):
    print(f"{'case':48}{'pull':>6}{'68':>7}{'95':>7}{'3 σ':>7}{'error':>8}{'plain: pull':>14}{'95':>7}{'error':>8}")
    for truth, lmax, kind, n, robust in CASES:
        name = f"{truth}, L = {lmax}, {kind}, {n} sources{', robust first' if robust else ''}"
        if words not in name:
            continue
        rows, lost = [], 0
        for seed in range(skies):
            try:
                rows.append(one(truth, lmax, kind, n, robust, seed))
            except DegeneracyError:
                lost += 1
        line = f"{name:48}"
        for k in range(2):
            values, errors = np.array([row[k] for row in rows]).transpose(1, 0, 2)
            pull = np.abs(values / errors)
            within = [np.mean(pull < x) for x in ((1, 1.96, 3) if k == 0 else (1.96,))]
            line += f"{np.sqrt(np.mean(pull**2)):>{6 if k == 0 else 14}.2f}"
            line += "".join(f"{x:>7.3f}" for x in within) + f"{np.sqrt(np.mean(errors**2)):>8.2f}"
        print(line + (f"  ({lost} skies have no floor)" if lost else ""), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, " ".join(sys.argv[2:]))
