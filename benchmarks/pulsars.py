"""Gravitational waves from pulsars and motions together.

`python benchmarks/pulsars.py coverage [SKIES]`: how often 68 % intervals and 95 % limits hold, by the true Ω in errors of both
together: pulsars alone, motions alone, both. Motions and noise of the pulsars are made so that both tell as much.

`python benchmarks/pulsars.py strong [SKIES]`: the same for pulsars alone where the waves are as strong as their noise, and stronger.

`python benchmarks/pulsars.py forecast`: the error of h70² Ω at 1/(15 yr) by the number of pulsars and the release.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from dataclasses import replace

import numpy as np

import fit
import sim
from fit.background import Amplitude, add_pulsars, wave_limit
from fit.background._waves import MPC
from sim.pulsars import timing_noise
from vsh import Field
from vsh.tools.units import JULIAN_YEAR

YEARS, SLOPE, FREQUENCY = 3.0, 2 / 3, 1 / 15
#: ∫ Ω d ln f below 1/T for a squared strain of one at FREQUENCY.
BAND = 2 * np.pi**2 * FREQUENCY**2 / (3 * (70 / MPC * JULIAN_YEAR) ** 2) * (YEARS * FREQUENCY) ** -SLOPE / SLOPE


def _motions(omega, rng, n=1500, sigma=30.0):
    lon, lat = sim.population.uniform_sky(n, rng)
    motion = sigma * rng.standard_normal((2, n))
    if omega > 0:
        motion += sim.wave_background(omega, rng=rng)(lon, lat)
    return wave_limit(fit.normal_equations(Field(lon, lat, motion, np.full((2, n), sigma)), 2), noise_scale=False)


def _flat(limit, top):
    """A limit that says nothing."""
    root = np.linspace(0, np.sqrt(top), 2000)
    return replace(limit, amplitude=Amplitude(root, np.zeros(len(root))))


def coverage(skies=300):
    unit = np.mean([_motions(0.0, np.random.default_rng([9, i])).limit() / 2 for i in range(20)])  # about one error
    n, bins = 30, 10
    gamma2 = n * (n - 1) / 2 / 48  # Σ Γ² of pulsars anywhere
    noise = unit / BAND * np.sqrt(2 * bins * gamma2)  # so that pulsars have the same error
    print(f"error of Ω: {unit:.3g}, of squared strains over the noise of a pulsar {unit / BAND / noise:.3f}")
    print(
        f"{'Ω / error':>10} {'pulsars: 68 %, limit':>24} {'motions: 68 %, limit':>24} {'both: 68 %, limit':>24} {'likeliest: pulsars, motions, both':>34}"
    )
    for size in (0.0, 1.0, 2.0, 4.0, 8.0):
        omega, held, best = size * unit, [], []
        for sky in range(int(skies)):
            rng = np.random.default_rng([int(size), sky])
            motions = _motions(omega, rng)
            pairs = sim.pulsar_pairs(n, omega / BAND, noise, rng, bins=bins)
            both, alone = (
                add_pulsars(each, pairs, YEARS, bins, frequency=FREQUENCY, slope=SLOPE)
                for each in (motions, _flat(motions, 100 * unit))
            )
            row, values = [], []
            for each in (alone, motions, both):
                low, high = each.interval
                row += [low <= omega <= high, omega <= each.limit()]
                values.append(each.maximum / unit)
            held.append(row)
            best.append(values)
        share, mean = np.mean(held, 0), np.median(best, 0)
        print(
            f"{size:10.0f} "
            + " ".join(f"{share[2 * k]:16.3f}{share[2 * k + 1]:8.3f}" for k in range(3))
            + "  "
            + " ".join(f"{v:10.2f}" for v in mean),
            flush=True,
        )


def strong(skies=300):
    """Waves from none to ten times the noise of the pulsars; and noise that is wrong."""
    limit = _motions(0.0, np.random.default_rng(1))
    print(f"{'power/noise':>12}{'pulsars':>9}{'noise off by':>14}{'68 %':>8}{'limit':>8}")
    for n in (30, 60):
        for size, scatter, bias in (
            (0.0, 0, 0), (0.1, 0, 0), (0.3, 0, 0), (1.0, 0, 0), (10.0, 0, 0), (0.0, 0.1, 0), (0.3, 0.1, 0), (0.3, 0.3, 0),
            (0.0, 0, -0.1), (0.3, 0, -0.1), (0.3, 0, 0.1),
        ):  # fmt: skip
            held = []
            for sky in range(int(skies)):
                rng = np.random.default_rng([int(10 * size), n, sky])
                pairs = sim.pulsar_pairs(n, size, 1.0, rng)
                pairs["noise"] *= (1 + bias) * np.exp(scatter * rng.standard_normal(len(pairs)))
                found = add_pulsars(_flat(limit, 100 * BAND), pairs, YEARS, 10, frequency=FREQUENCY, slope=SLOPE)
                low, high = found.interval
                held.append((low <= size * BAND <= high, size * BAND <= found.limit()))
            share = np.mean(held, 0)
            print(f"{size:12.1f}{n:9d}{bias or scatter:14.1f}{share[0]:8.3f}{share[1]:8.3f}", flush=True)


def forecast():
    print(
        "error of h70² Ω at 1/(15 yr), residuals of 100 ns every 14 days, three lowest bins; Gaia: degree 2, Ω ∝ f^(2/3)"
    )
    to_reference = 2 * np.pi**2 * FREQUENCY**2 / (3 * (70 / MPC * JULIAN_YEAR) ** 2)
    for n in (20, 67, 130, 300):
        information = 0.0
        for k in (1, 2, 3):
            f = k * FREQUENCY
            noise = timing_noise(100.0, 14.0, f)
            scale = (f / FREQUENCY) ** (SLOPE - 2)  # h_c² there for one at the reference
            information += n * (n - 1) / 2 / 48 * 2 * scale**2 / noise**2
        print(f"{n:5d} pulsars: {to_reference / np.sqrt(information):.2g}")
    for release in ("DR3", "DR4", "DR5"):
        field = sim.observe(sim.quasars(1_200_000, 1), sim.spin((0, 0, 0)), 2, release=release)
        limit = wave_limit(fit.normal_equations(field, 2), noise_scale=False)
        years = {"DR3": 2.8, "DR4": 5.5, "DR5": 10.0}[release]
        print(f"{release}: {limit.limit() / 2 * SLOPE * (years * FREQUENCY) ** SLOPE:.2g} (formal errors)", flush=True)


if __name__ == "__main__":
    {"coverage": coverage, "strong": strong, "forecast": forecast}[sys.argv[1]](*map(int, sys.argv[2:]))
