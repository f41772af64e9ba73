"""Motions from epochs of sources whose colours are not what they were taken for.

`python benchmarks/pseudocolours.py [SOURCES]`: share of components of motions within 1 and 1.96 errors of the truth, with and without
a pseudocolour, by the scatter of the effective wavenumber and the size of the colour factor; error of a motion, and time.
"""

import sys
import time

import numpy as np

import sim
from vsh.io.epochs import read_observations, solve_epochs


def main(sources=2000):
    rng = np.random.default_rng(1)
    population = sim.quasars(int(sources), rng, max_magnitude=19.5)
    seen = read_observations(sim.epochs(population, sim.spin((0.0, 0.0, 0.0)), 2))
    # Of a transit in either field and of each CCD, as chromaticity is. [mas µm]
    shape = 0.5 * rng.choice([-1, 1], len(seen.time)) + rng.normal(0, 0.8, len(seen.time))
    print(
        f"{'scatter':>8}{'factor':>8} | with: 68 %, 95 %, σ [µas/yr], ms a source | without: 68 %, 95 %, σ, ms a source"
    )
    for scatter in (0.0, 0.03, 0.085, 0.17):
        for size in (3.0, 30.0):
            colour = 1000 * size * shape
            shift = colour * (scatter * rng.standard_normal(int(sources)))[seen.source]
            row = f"{scatter:8.3f}{size:8.0f} |"
            for column in (colour, None):
                start = time.process_time()
                found = solve_epochs(
                    seen.source, seen.design, seen.position - shift, seen.error, colour=column, robust=False
                )
                cpu = 1e3 * (time.process_time() - start) / int(sources)
                sigma = np.sqrt(np.einsum("nii->ni", found.covariance)[:, 3:])
                pull = np.abs(found.values[:, 3:] / sigma)[found.solved]
                row += f"{np.mean(pull < 1):8.3f}{np.mean(pull < 1.96):8.3f}{np.nanmedian(sigma):8.0f}{cpu:8.2f}   |"
            print(row, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
