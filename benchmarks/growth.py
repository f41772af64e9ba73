"""The growth rate from motions and the density of galaxies, on skies with a known truth.

`python benchmarks/growth.py [SKIES]`: f/b by its size in errors (0, 1, 2, 3 and 6, and with twice the bias): mean, coverage of 68 % intervals
and of 95 % limits, P(p < .05) for zero; time of the fit beside a plain fit.

`python benchmarks/growth.py forecast`: errors by number of galaxies and release, with 215 µas of excess noise in every transit.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
import time

import numpy as np
from scipy.special import ndtr

import fit
import sim
from fit.motions.growth import growth
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, flow_of_galaxies
from vsh.sky.pixels import centres

F, H = LINEAR_PLANCK18.growth_rate, hubble_value(FLAT_PLANCK13) / 100


def reconstructed(population, **options):
    return flow_of_galaxies(population.lon, population.lat, transverse_distance(population.redshift) * H, **options)


def skies(number=200, n=10_000):
    names = ("no flow", "1", "2", "3", "6", "3, smoothed 5", "3, plane hidden", "3, bias 1.3")
    results = {name: [] for name in names}
    truth = {name: F for name in names} | {"no flow": 0.0, "3, bias 1.3": F / 1.3}
    cpu = [0.0, 0.0]
    for seed in range(int(number)):
        for name in names:
            bias = 1.3 if "bias" in name else 1.0
            if name in ("no flow", "3, bias 1.3"):
                population, grid = sim.clustered_galaxies(n, [seed, int(10 * bias)], size=96, bias=bias)
                flow = reconstructed(population, size=96)
            errors = float(name[0]) if name[0].isdigit() else 3.0
            flows = sim.peculiar(200.0, [seed, 1], flow=grid if truth[name] else None)
            others = sim.spin((5.0, -3.0, 2.0)) + sim.acceleration((0.0, 0.0, 4.0))
            field, used = sim.observe(population, flows + others, [seed, 2], sigma=66.0 / errors), flow
            if "smoothed" in name:
                used = reconstructed(population, size=96, smoothing=5.0)
            if "hidden" in name:
                visible = np.abs(centres(16)[1]) > np.radians(15)
                field = field[np.abs(field.lat) > np.radians(15)]
                distance = transverse_distance(field.redshift) * H
                used = flow_of_galaxies(field.lon, field.lat, distance, size=96, visible=visible)
            start = time.process_time()
            result = growth(field, used)
            cpu[0] += time.process_time() - start
            start = time.process_time()
            fit.fit_field(field, 1)
            cpu[1] += time.process_time() - start
            value, error = result.beta
            held = abs(value - truth[name]) < error
            results[name].append(
                (value, error, held, result.limit() > truth[name], 2 * ndtr(-abs(value / error)) < 0.05)
            )
    print(
        f"{'f/b in errors':>16}{'truth':>7}{'mean':>7}{'error':>7}{'scatter':>9}{'68 %':>7}{'limit':>7}{'p < .05':>9}"
    )
    for name, rows in results.items():
        value, error, held, below, seen = np.array(rows, float).T
        print(
            f"{name:>16}{truth[name]:7.3f}{value.mean():7.3f}{error.mean():7.3f}{value.std():9.3f}{held.mean():7.3f}{below.mean():7.3f}{seen.mean():9.3f}",
            flush=True,
        )
    print(f"CPU of the fit over that of a plain fit of degree 1: {cpu[0] / cpu[1]:.2f}")


def forecast():
    for release in ("DR3", "DR4", "DR5"):
        for n in (10_000, 100_000):
            population, grid = sim.clustered_galaxies(n, 1, size=96, max_redshift=0.05)
            field = sim.observe(population, sim.peculiar(300.0, 2, flow=grid), 3, release=release, excess_noise=215.0)
            result = growth(field, reconstructed(population, size=128))
            print(f"{release}, {n} galaxies to z = 0.05: f/b ± {result.beta[1]:.2g}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["forecast"]:
        forecast()
    else:
        skies(*map(int, sys.argv[1:]))
