"""Our velocity from redshifts as they are: bias, pulls and coverage beside perfect redshifts and the naive estimate.

    python benchmarks/redshifts.py [skies] [processes]

Skies of 20 000 galaxies, 0.002 < z < 0.03 as observed, with DR5's errors by magnitude; truth 369 km/s and 67.3.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

import sim
from fit.secular_parallax import observer_velocity
from vsh.models.cosmology import BACHCHAN_2016, to_cmb

OURS = BACHCHAN_2016.to_frame("icrs").value
ACCELERATION = np.array([-0.236, -3.756, -2.080])
CASES = [
    ("dispersion 300", 300.0, 0.0, "whole"), ("dispersion 300", 300.0, 0.0, "half"),
    ("dispersion 750", 750.0, 0.0, "whole"), ("dispersion 750", 750.0, 0.0, "half"),
    ("300, photometric .003", 300.0, 0.003, "whole"), ("300, photometric .003", 300.0, 0.003, "half"),
]  # fmt: skip


def sky(seed: int, dispersion: float, error: float, part: str, n: int = 20_000):
    """One sky as observed, and the same with true redshifts."""
    rng = np.random.default_rng([14, seed])
    population = sim.galaxies(int(4.5 * n) * (2 if part == "half" else 1), rng, min_redshift=2e-4, max_redshift=0.05)
    if part == "half":  # toward the apex, where frames matter most
        toward = OURS / np.linalg.norm(OURS)
        r = np.stack(
            [
                np.cos(population.lat) * np.cos(population.lon),
                np.cos(population.lat) * np.sin(population.lon),
                np.sin(population.lat),
            ]
        )
        population = population[toward @ r > 0]
    signal = sim.secular_parallax(OURS) + sim.acceleration(ACCELERATION) + sim.peculiar(dispersion, rng)
    seen = sim.observe(population, signal, rng, release="DR5", redshifts="heliocentric", redshift_error=error)
    z = to_cmb(seen.redshift, seen.lon, seen.lat, "icrs", "heliocentric")
    keep = np.flatnonzero((z > 0.002) & (z < 0.03))[:n]
    seen = seen[keep]
    return seen, replace(seen, redshift=population.redshift[keep], redshift_error=None, redshift_frame="true")


def estimates(task):
    """Values and errors of v by each estimator, for one sky."""
    seed, (_, dispersion, error, part) = task
    seen, true = sky(seed, dispersion, error, part)
    naive = replace(seen, redshift_error=None)
    ways = {
        "true redshifts": lambda: observer_velocity(true, 67.3, peculiar_dispersion=dispersion),
        "naive (as before)": lambda: observer_velocity(
            naive, 67.3, peculiar_dispersion=dispersion, redshift_frame="true"
        ),
        "with magnitudes": lambda: observer_velocity(seen, 67.3, peculiar_dispersion=dispersion),
        "without": lambda: observer_velocity(seen, 67.3, peculiar_dispersion=dispersion, magnitudes=False),
    }
    found = {name: way().velocity for name, way in ways.items()}
    return {name: (v.value - OURS, v.sigma) for name, v in found.items()}


def main(skies: int = 150, processes: int = 2) -> None:
    """Print a table for every case."""
    with ProcessPoolExecutor(processes) as pool:
        for case in CASES:
            found = list(pool.map(estimates, [(seed, case) for seed in range(skies)], chunksize=4))
            print(f"\n{case[0]}, {case[3]} sky, {skies} skies")
            print(
                f"{'':20}{'mean along the apex':>22}{'its error':>10}{'off truth [σ]':>14}{'off true-z [σ]':>15}{'pulls':>8}{'68 %':>7}"
            )
            unit = OURS / np.linalg.norm(OURS)
            truth = np.array([each["true redshifts"][0] for each in found]) @ unit
            for name in found[0]:
                off = np.array([each[name][0] for each in found])
                sigma = np.array([each[name][1] for each in found])
                along, error = off @ unit, np.sqrt(np.mean(sigma**2))
                pulls = off / sigma
                print(
                    f"{name:20}{369 + along.mean():15.1f} ± {along.std() / np.sqrt(skies):4.1f}{error:10.1f}{along.mean() / error:+14.2f}"
                    f"{(along - truth).mean() / error:+15.2f}{pulls.std():8.2f}{np.mean(np.abs(pulls) < 1):7.2f}",
                    flush=True,
                )  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
