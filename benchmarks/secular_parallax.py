"""Our velocity and H0 from the paper's galaxies, a hundred times; and the time that posteriors take.

Run as `python benchmarks/secular_parallax.py [SKIES]`. One mission gives the errors of 100 000 galaxies; each sky
draws noise with these errors, peculiar velocities, and the secular parallax of the paper's velocity.
"""

import sys
import time

import numpy as np

import sim
from fit.posterior import Flat, grid, sample
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh.models.cosmology import BACHCHAN_2016, CMB_VELOCITY_PLANCK18

SKIES = int(sys.argv[1]) if len(sys.argv) > 1 else 100
ACCELERATION = np.array([-0.236, -3.756, -2.080])
VELOCITY = BACHCHAN_2016.to_frame("icrs").value
#: Bachchan et al. (2016), table 7 (velocity, H0, galaxies), case A: mean formal errors and standard deviations.
PAPER_ERRORS = {"v_x": 98.7, "v_y": 97.8, "v_z": 97.2, "H0": 18.15, "a_x": 0.270, "a_y": 0.270, "a_z": 0.270}


def main():
    galaxies = sim.galaxies(100_000, rng=1)
    law = sim.NominalScanningLaw(dead_time=0.06, rng=2)
    quiet = sim.spin((0, 0, 0))
    measured = sim.observe(galaxies, quiet, rng=3, mission=law, release="paper", excess_noise=215.0, progress=False)
    steady = sim.secular_parallax(VELOCITY) + sim.acceleration(ACCELERATION)
    rows = []
    for sky in range(SKIES):
        truth = steady + sim.peculiar(750.0, rng=[4, sky])
        field = sim.observe(galaxies, truth, rng=[5, sky], sigma=measured.sigma, rho=measured.rho)
        velocity, hubble = observer_velocity(field.to_frame("galactic"), 67.3), hubble_constant(field, BACHCHAN_2016)
        rows.append(([*velocity.values[:3], hubble.hubble, *velocity.values[3:]],
                     [*velocity.sigma[:3], hubble.hubble_error, *velocity.sigma[3:]]))  # fmt: skip
    values, errors = (np.array(each) for each in zip(*rows, strict=True))
    truths = [*BACHCHAN_2016.value, 67.3, 4.3, 0.0, 0.0]
    pulls = (values.mean(0) - truths) / (values.std(0, ddof=1) / np.sqrt(SKIES))
    print(f"{SKIES} skies of 100 000 galaxies, Galactic axes")
    print(f"{'':6}{'truth':>10}{'mean':>10}{'off/s.e.':>10}{'scatter':>10}{'formal':>10}{'ratio':>8}{'paper':>8}")
    for row in zip(PAPER_ERRORS, truths, values.mean(0), pulls, values.std(0, ddof=1), errors.mean(0),
                   PAPER_ERRORS.values(), strict=True):  # fmt: skip
        name, truth, mean, pull, scatter, formal, paper = row
        print(
            f"{name:6}{truth:10.3f}{mean:10.3f}{pull:10.2f}{scatter:10.3f}{formal:10.3f}{scatter / formal:8.3f}{paper:8.3g}"
        )
    print(f"scatter over formal error, all together: {np.sqrt(np.mean(((values - truths) / errors) ** 2)):.3f}")
    ignored = observer_velocity(field, 67.3, peculiar_dispersion=0.0)
    print(f"formal errors of v with peculiar velocities ignored: {ignored.velocity.sigma.round(1)}")

    for words, options in (("v and H0", {}), ("v, H0 and the dispersion", {"peculiar_dispersion": Flat(0, 2000)}),
                           ("v, H0, dispersion, excess noise", {"peculiar_dispersion": Flat(0, 2000), "excess_noise": Flat(0, 50)})):  # fmt: skip
        begin = time.perf_counter()
        found = sample(
            field, CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=1_000_000, rng=6, progress=False, **options
        )
        seconds = time.perf_counter() - begin
        slowest = max(found.autocorrelation.values())
        print(f"10⁶ samples of {words}: {seconds:.1f} s; {len(found.chain) / slowest:.0f} autocorrelation times")
        if len(options) < 2:
            on_grid = grid(field, CMB_VELOCITY_PLANCK18, Flat(20, 150), **options)
            h = found.samples["H0"]
            print(
                f"   H0 {h.mean():.2f} ± {h.std():.2f}; on a grid {on_grid.mean('H0'):.2f} ± {on_grid.sigma('H0'):.2f}"
            )


if __name__ == "__main__":
    main()
