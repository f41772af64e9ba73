"""Can the non-uniform list of quasars alone turn 4.3 µas/yr into 6.0? The numbers of docs/theory.md.

The sky and errors of the paper's case D (Bachchan, Hobbs & Lindegren 2016): 500 000 quasars of the IGQL-like
sky, errors of the nominal scanning law by place and magnitude.
"""

import sys

import numpy as np

import fit
import sim
from fit.correlation import correlation_matrices, leakage
from sim.expected import errors_by_place
from vsh import Field, Modes

SKIES = int(sys.argv[1]) if len(sys.argv) > 1 else 200
#: Table 5 of the paper, case D: mean ω and ã found, Galactic axes; the truth was ω = 0, ã = (4.3, 0, 0).
FOUND_SPIN, FOUND = np.array([-1.083, -4.473, 1.184]), np.array([5.578, 1.657, -1.654])
TRUTH = np.array([4.3, 0.0, 0.0])
NAMES = ("a_x", "a_y", "a_z", "omega_x", "omega_y", "omega_z")


def main(n=500_000):
    quasars = sim.quasars(n, 1, "igql")
    law = sim.NominalScanningLaw(dead_time=0.06, rng=2)
    sigma, rho = errors_by_place(quasars.magnitude, quasars.lon, quasars.lat, law, release="paper")
    field = Field(quasars.lon, quasars.lat, np.zeros((2, n)), sigma, rho).to_frame("galactic")
    print(correlation_matrices(field).report())

    true = Field.from_positions(field)._derive(motion=sim.acceleration(TRUTH)(field.lon, field.lat))
    rng = np.random.default_rng(3)
    found = []
    for _ in range(SKIES):
        unit = rng.standard_normal((2, n))
        noise = field.sigma * np.stack([unit[0], field.rho * unit[0] + np.sqrt(1 - field.rho**2) * unit[1]])
        found.append(fit.fit_field(true.minus(-noise), 1).acceleration.value)
    found = np.array(found)
    print(
        f"noise and correlations alone, {SKIES} skies: mean ã {found.mean(0).round(3)}, scatter {found.std(0).round(3)}"
    )
    print(
        f"   mean |ã| {np.linalg.norm(found, axis=1).mean():.3f}, largest {np.linalg.norm(found, axis=1).max():.3f}; paper 6.05"
    )

    leak = leakage(field, 1, 4)
    needed = np.linalg.norm(FOUND - TRUTH)
    rms = np.sqrt(sum(leak.bias_of(NAMES[:3], 1.0)[name] ** 2 for name in NAMES[:3]))
    spin = np.sqrt(sum(leak.bias_of(NAMES[3:], 1.0)[name] ** 2 for name in NAMES[3:]))
    power = (needed / rms) ** 2
    motion = np.sqrt(6 * power / (4 * np.pi))
    print(f"the paper's bias of ã: {needed:.2f} µas/yr; of ω: {np.linalg.norm(FOUND_SPIN):.2f}")
    print(f"unmodelled degrees 2 to 4, power P each of T and S: rms bias of ã {rms:.3f} √P, of ω {spin:.3f} √P")
    print(
        f"   so P = {power:.0f} (µas/yr)², a field of rms {motion:.1f} µas/yr, gives the paper's bias of ã; of ω, {spin * np.sqrt(power):.2f}"
    )

    biased, spins = [], []
    for seed in range(SKIES):
        signal = sim.random_field(np.r_[0.0, np.full(3, power)], rng=seed)
        coefficients = leak.of(signal_coefficients(signal, power, seed))
        biased.append(coefficients.glide)
        spins.append(coefficients.rotation)
    biased, spins = np.array(biased), np.array(spins)
    few = 10
    direct = []
    for seed in range(few):  # the matrix against fits of the very fields
        signal = sim.random_field(np.r_[0.0, np.full(3, power)], rng=seed)
        solution = fit.fit_field(field._derive(motion=signal(field.lon, field.lat)), 1)
        direct.append(np.abs(solution.acceleration.value - biased[seed]).max())
    lengths = np.linalg.norm(TRUTH + biased, axis=1)
    print(f"simulated, {SKIES} fields: rms bias of ã {np.sqrt(np.mean(np.sum(biased**2, 1))):.2f}, of ω "
          f"{np.sqrt(np.mean(np.sum(spins**2, 1))):.2f}; |ã| {lengths.mean():.2f} on average, above 6.05 in "
          f"{100 * np.mean(lengths > 6.05):.0f} % of them; leakage matrix against {few} fits: {max(direct):.1e} µas/yr")  # fmt: skip
    gums = sim.quasars(n, 1, "gums")
    sigma, rho = errors_by_place(gums.magnitude, gums.lon, gums.lat, law, release="paper")
    even = leakage(Field(gums.lon, gums.lat, np.zeros((2, n)), sigma, rho).to_frame("galactic"), 1, 4)
    rms = np.sqrt(sum(even.bias_of(NAMES[:3], power)[name] ** 2 for name in NAMES[:3]))
    print(f"the same field on the GUMS-like sky: rms bias of ã {rms:.2f} µas/yr")
    degree_4 = fit.fit_field(field, 4)
    print(f"a fit of degree 4 in place of 1 would have σ of ã {degree_4.acceleration.sigma.round(3)}, "
          f"degree 1 has {fit.fit_field(field, 1).acceleration.sigma.round(3)}")  # fmt: skip


def signal_coefficients(signal, power, seed):
    """The coefficients behind `sim.random_field`: drawn again in the same way."""
    modes = Modes(4)
    l = modes.degrees
    sigma = np.sqrt(np.r_[0.0, np.full(3, power)][l - 1] / (2 * l + 1) / modes.norm2)
    from vsh import Coefficients

    return Coefficients(modes, sigma * np.random.default_rng(seed).standard_normal(len(modes)))


if __name__ == "__main__":
    main()
