"""Our velocity under flows that galaxies share: do the errors hold? Flows are drawn from the full covariance.

    python benchmarks/flows.py [places] [skies at each place] [modes] [1 for galaxies that cluster]

Some 3400 galaxies, 0.002 < z < 0.03 as observed, with DR5's errors by magnitude, 150 km/s beside the flow; truth 369 km/s.
"""

from __future__ import annotations

import sys

import numpy as np

import sim
from fit.secular_parallax import observer_velocity
from vsh.models.cosmology import BACHCHAN_2016, to_cmb

OURS = BACHCHAN_2016.to_frame("icrs").value
ACCELERATION = np.array([-0.236, -3.756, -2.080])


def universe(rng, population, clustered):
    """Galaxies and their velocities."""
    if not clustered:
        return population, sim.peculiar(150.0, rng, flow="linear", exact=True)
    population, grid = sim.clustered_galaxies(4800, rng, max_redshift=0.033)
    return population, sim.peculiar(150.0, rng, flow=grid)


def main(places: int = 10, skies: int = 20, n_modes: int = 250, clustered: int = 0) -> None:
    """Print χ², coverage and errors of both estimators."""
    ways = {"independent": {"peculiar_dispersion": 306.0}, "flows": {"flows": "linear", "n_modes": n_modes}}
    found: dict[str, list] = {name: [] for name in ways}
    galaxies = []
    for place in range(places):
        rng = np.random.default_rng([41, place])
        population = sim.galaxies(4800, rng, max_redshift=0.033)
        for _ in range(skies):
            population, velocities = universe(rng, population, clustered)
            signal = sim.secular_parallax(OURS) + sim.acceleration(ACCELERATION) + velocities
            seen = sim.observe(population, signal, rng, release="DR5", redshifts="heliocentric")
            z = to_cmb(seen.redshift, seen.lon, seen.lat, "icrs", "heliocentric")
            seen = seen[(z > 0.002) & (z < 0.03)]
            galaxies.append(len(seen))
            for name, options in ways.items():
                v = observer_velocity(seen, 67.3, **options).velocity
                found[name].append(
                    (v.value - OURS, v.sigma, (v.value - OURS) @ np.linalg.solve(v.covariance, v.value - OURS))
                )
        print(f"place {place + 1} of {places}", file=sys.stderr, flush=True)
    print(f"{places} places, {skies} skies at each, {min(galaxies)} to {max(galaxies)} galaxies, {n_modes} modes\n")
    print(f"{'':14}{'quoted':>9}{'true scatter':>14}{'mean χ²(3)':>17}{'68 %':>7}{'95 %':>7}{'mean v':>24}")
    for name, each in found.items():
        off, sigma, chi2 = (np.array([x[i] for x in each]) for i in range(3))
        pulls = np.abs(off / sigma)
        mean = ", ".join(f"{x:+.0f}" for x in off.mean(0))
        print(
            f"{name:14}{np.sqrt(np.mean(sigma**2)):9.0f}{np.sqrt(np.mean(off**2)):14.0f}{chi2.mean():10.2f} ± {chi2.std() / np.sqrt(len(chi2)):4.2f}"
            f"{np.mean(pulls < 1):7.2f}{np.mean(pulls < 1.96):7.2f}{mean:>20} ± {off.std() / np.sqrt(len(off)):.0f}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
