"""Half a million quasars through five years, and the paper's formal errors and correlations.

    python benchmarks/simulation.py [SOURCES]

Prints time and peak memory, and beside the paper's numbers (Bachchan et al. 2016, Tables 3 to 5)
those of cases A and D and of the galaxies.
"""

import resource
import sys
import time

import numpy as np

import fit
import sim
from fit.secular_parallax import observer_velocity

PAPER = {"gums": (0.144, 0.147, 0.159, 0.145, 0.146, 0.159), "igql": (0.171, 0.167, 0.211, 0.172, 0.167, 0.211)}
TIES = [[0.002, 0.444, -0.330], [-0.444, -0.004, -0.262], [0.328, 0.264, 0.002]]


def main(n=500_000):
    np.set_printoptions(precision=3, suppress=True, linewidth=110)
    law = sim.NominalScanningLaw(dead_time=0.06, rng=3)
    for sky, variability in (("gums", sim.Variability(100.0, 2.0)), ("igql", None)):
        start = time.perf_counter()
        quasars = sim.quasars(n, 1, sky)
        field = sim.observe(
            quasars, sim.acceleration((-0.235965, -3.755779, -2.080491)), 2, mission=law, release="paper",
            variability=variability, progress=False,
        )  # fmt: skip
        seconds = time.perf_counter() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        found = fit.solve_frame(field.to_frame("galactic"))
        print(f"{sky}: {field.notes[0]}; variability {variability}: {seconds:.1f} s, peak memory {peak:.2f} GiB")
        scaled = found.sigma * np.sqrt(n / 500_000)
        print(f"  σ of ω, ã  {scaled}\n  paper      {np.array(PAPER[sky])}\n  ratio      {scaled / PAPER[sky]}")
        print(f"  ã          {found.acceleration.value} ± {found.acceleration.sigma}")
        if sky == "igql":
            print(
                f"  ω–ã correlations\n{found.correlation[:3, 3:]}\n  less the paper's\n{found.correlation[:3, 3:] - TIES}"
            )
    galaxies = sim.galaxies(100_000, 1, "gums")
    field = sim.observe(
        galaxies, sim.spin((0, 0, 0)), 2, mission=law, release="paper", excess_noise=215.0, progress=False
    )
    found = observer_velocity(field.to_frame("galactic"), 67.3)
    print("galaxies: σ of v and ã, solved together:", found.sigma, "paper 98.7 97.8 97.2 0.27 0.27 0.27")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
