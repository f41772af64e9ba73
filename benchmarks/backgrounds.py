"""Errors that sources share: what a plain fit quotes, and what a floor restores.

    python benchmarks/backgrounds.py [skies] [seed]

Quasars outside the Galactic plane with Gaia DR3's errors; systematics in degrees 2 to 24, of unequal power in the two
parities (20 and 5 (µas/yr)² a mode to degree 7, falling by e in five degrees beyond). Skies are drawn by their normal equations, which is exact: b = N c + N^½ e.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

import fit
import sim
from fit.background import floor
from vsh import Modes
from vsh.models.covariance import Spectrum

LMAX, PER_MODE = 24, (20.0, 5.0)


def information():
    """The normal equations of 200 000 quasars to degree 24, without their motions."""
    quasars = sim.quasars(200_000, rng=1, sky="plane-avoiding", max_magnitude=20.5)
    return fit.normal_equations(sim.observe(quasars, sim.spin((0, 0, 0)), rng=2, release="DR3"), LMAX)


def truth_spectrum(strength):
    """Systematics of a strength in degrees 2 to 24; nothing in degree 1, whose share is drawn with the same power."""
    l = np.arange(1, LMAX + 1)
    shape = np.exp(-np.maximum(l - 7, 0) / 5) * (2 * l + 1)
    odd = Spectrum.given(PER_MODE[0] * shape).only("odd")
    return strength * (odd + Spectrum.given(PER_MODE[1] * shape).only("even"))


def skies(normal, spectrum, number, rng, noise_scale=1.0):
    """Normal equations of so many skies, with degree 1 of the systematics as the truth to be covered."""
    root, sigma = np.linalg.cholesky(normal.matrix), np.sqrt(spectrum.variances(normal.modes))
    for _ in range(number):
        c, e = sigma * rng.standard_normal(len(sigma)), noise_scale * rng.standard_normal(len(sigma))
        rest = noise_scale**2 * rng.chisquare(normal.n_data - len(sigma))
        chi2 = float(c @ normal.matrix @ c + 2 * c @ (root @ e) + e @ e + rest)
        yield replace(normal, rhs=normal.matrix @ c + root @ e, chi2_null=chi2)


def cut(normal, lmax):
    """The same to a lower degree."""
    keep = normal.modes.degrees <= lmax
    return replace(normal, modes=Modes(lmax), matrix=normal.matrix[np.ix_(keep, keep)], rhs=normal.rhs[keep])


def run(normal, strength, lmax, number, seed):
    """Errors and quoted errors of spin and acceleration by three ways, and the floors."""
    spectrum, rng, found, floors = truth_spectrum(strength), np.random.default_rng(seed), {}, []
    for sky in skies(normal, spectrum, number, rng):
        sky = cut(sky, lmax)
        plain, shared = fit.solve(sky), floor(sky)
        floors.append(shared)
        with_floor = np.array(plain.covariance)
        first = sky.modes.degrees == 1
        with_floor[first, first] += shared.spectrum.variances(sky.modes)[first]
        ways = {
            "plain": plain,
            "plain + floor": replace(plain, covariance=with_floor),
            "prior + floor": fit.solve(sky, floor=shared),
        }
        for way, solution in ways.items():
            for name, vector in (("spin", solution.spin), ("acceleration", solution.acceleration)):
                found.setdefault((way, name), []).append((vector.value, vector.sigma))
    return found, floors


def table(found):
    """True rms, quoted, shares within one and 1.96 quoted errors."""
    for (way, name), values in found.items():
        error, sigma = np.array(values).transpose(1, 0, 2)
        inside = [np.mean(np.abs(error) < limit * sigma) for limit in (1, 1.96)]
        print(
            f"  {way:15}{name:14}{np.sqrt(np.mean(error**2)):8.3f}{np.sqrt(np.mean(sigma**2)):9.3f}{inside[0]:9.3f}{inside[1]:7.3f}"
        )


def powers(floors, strength):
    """The mean power of a mode of each parity, and how often the truth is in its 68 % interval."""
    said = []
    for name, true in zip(("odd", "even"), PER_MODE, strict=True):
        inside = np.mean(
            [low <= strength * true <= high for low, high in (getattr(f, f"{name}_interval") for f in floors)]
        )
        said.append(
            f"{name} {np.mean([getattr(f, name) for f in floors]):.2f} (truth {strength * true:g}, in its interval {inside:.2f})"
        )
    return ", ".join(said)


def main(number=300, seed=4):
    normal = information()
    print(f"{number} skies; degree of the fit, power of the systematics; true rms, quoted [µas/yr], covers 68, 95")
    for factor, words in ((1.0, "200 000 quasars"), (6.0, "1.2 million quasars' information")):
        more = replace(normal, matrix=factor * normal.matrix, n_data=int(factor * normal.n_data))
        for lmax in (3, 7):
            for strength in (1.0, 0.0):
                start = time.perf_counter()
                found, floors = run(more, strength, lmax, number, seed)
                print(
                    f"\n{words}, degree {lmax}, {'with' if strength else 'without'} systematics ({time.perf_counter() - start:.0f} s)"
                )
                table(found)
                print(f"  power of a mode, mean: {powers(floors, strength)}")
        # Amplitudes where the model is exact: systematics in the degrees that are fitted alone.
        low, spectrum = cut(more, 7), 20 * Spectrum.odd() + 5 * Spectrum.even()
        for strength in (1.0, 0.1, 0.0):
            floors = [floor(sky) for sky in skies(low, strength * spectrum, number, np.random.default_rng(seed + 1))]
            p = np.array([each.parity_p_value for each in floors])
            print(f"\n{words}, systematics {strength:g} times as strong in degrees 2 to 7 alone: {powers(floors, strength)}; "
                  f"parity p-value < .05 in {np.mean(p < 0.05):.2f}")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
