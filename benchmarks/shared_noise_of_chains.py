"""p-values of three catalogues without a difference that share noise, all sources alike or some of them.

`python benchmarks/shared_noise_of_chains.py [CHAINS] [SOURCES]` prints, for each way to share, how often the p-values of
rotation and glide, and of the deformation, are below 0.05 and 0.0027.
"""

import sys

import numpy as np
from shared_noise import SHARED

import sim
from fit.frames.chain import combine_frames
from vsh import Field


def chain(n, share, rng):
    """Three catalogues of one sky, errors over a factor 16, in one solution."""
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(0.8, 2.0, n)
    rho = share(sigma)
    common = np.sqrt(rho) * sigma * rng.normal(size=(2, n))
    catalogues = {}
    for label in "abc":
        motion = common + np.sqrt(1 - rho) * sigma * rng.normal(size=(2, n))
        catalogues[label] = Field(lon, lat, motion, np.tile(sigma, (2, 1)), name=np.arange(n))
    return combine_frames(catalogues, 2, floor=False)


def main(n_chains=200, n=500):
    for name, share in SHARED.items():
        rng, frames, deformation = np.random.default_rng(2), [], []
        for _ in range(n_chains):
            found = chain(n, share, rng)
            for solution in (found.difference("b"), found.difference("c", "b")):
                frames += [solution.spin.p_value, solution.acceleration.p_value]
            deformation.append(found.p_value("b", beyond=1))
        for label, p in (("rotation, glide", np.array(frames)), ("deformation", np.array(deformation))):
            print(f"{name:20} {label:16} {np.mean(p < 0.05):.3f} {np.mean(p < 0.0027):.4f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
