"""A chain that saves itself all the time; `python chain_to_kill.py CHECKPOINT OUTPUT` runs it, or goes on with it."""

import sys

import numpy as np

import sim
from fit.posterior import Flat, sample

if __name__ == "__main__":
    truth = sim.secular_parallax((300.0, 0, 0)) + sim.acceleration((0, 4, 0))
    field = sim.observe(sim.galaxies(500, rng=1), truth, rng=2, sigma=3.0)
    found = sample(
        field, "planck", Flat(20, 150), n_samples=40_000, rng=3, checkpoint=sys.argv[1], peculiar_dispersion=Flat(0, 1500), n_walkers=32, flows=None,
        progress=False, save_every=0.0,
    )  # fmt: skip
    np.save(sys.argv[2], found.chain)
