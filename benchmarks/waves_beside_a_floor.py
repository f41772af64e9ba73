"""Limits on gravitational waves beside a floor with a shape: how often they hold, and how low they are.

    python benchmarks/waves_beside_a_floor.py [SKIES]

A row has the spectrum of the systematics (a twentieth of the power of shared_errors.py) and the true h70² Ω; for degree 2
alone, and degrees 2 to 5 beside a flat, Gaia's and both shapes, how often the 95 % limit (flat in Ω) holds and its median.
"""

import sys

import numpy as np
from shared_errors import SOURCES, Skies, variances

from fit.background import SHAPES, Spectrum, wave_limit
from fit.normal import NormalEquations
from vsh import Modes

LMAX = 5
WAYS = {
    "degree 2": {},
    "flat": {"degrees": range(2, LMAX + 1)},
    "Gaia's": {"degrees": range(2, LMAX + 1), "systematics": [SHAPES["gaia"]]},
    "both": {"degrees": range(2, LMAX + 1), "systematics": list(SHAPES.values())},
}


def main(skies=60):
    sky = Skies(("plane",))
    modes, matrix, root = sky.modes, sky.matrices[0], sky.roots[0]
    at, waves = np.flatnonzero(modes.degrees <= LMAX), Spectrum.waves(70.0).variances(modes)
    print(f"{'systematics':14}{'Ω':>6}" + "".join(f"{way:>20}" for way in WAYS))
    for truth in ("none", "flat", "lindegren"):
        for omega in (0.0, 0.02):
            limits = []
            for seed in range(skies):
                rng = np.random.default_rng([3, seed])
                true = rng.normal(size=len(modes)) * np.sqrt(0.05 * variances(truth, modes) + omega * waves)
                noise = root @ rng.normal(size=len(modes))
                chi2 = true @ matrix @ true + 2 * true @ noise + rng.chisquare(2 * SOURCES)
                rhs = (matrix @ true + noise)[at]
                normal = NormalEquations(Modes(LMAX), matrix[np.ix_(at, at)], rhs, float(chi2), 2 * SOURCES, "icrs")
                limits.append([wave_limit(normal, **given).limit() for given in WAYS.values()])
            holds, middle = np.mean(np.array(limits) > omega, axis=0), np.median(limits, axis=0)
            cells = "".join(f"{f'{h:.3f}, {m:.3f}':>20}" for h, m in zip(holds, middle, strict=True))
            print(f"{truth:14}{omega:6g}{cells}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
