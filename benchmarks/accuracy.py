"""How far compressed and direct solutions part as the sky, and so N, gets worse.

python benchmarks/accuracy.py
"""

import numpy as np

import fit
from vsh import Field, Modes


def cap(n, radius, seed=1):
    """n sources within `radius` degrees of the pole, errors over 2.5 decades, correlations to ±0.99."""
    rng = np.random.default_rng(seed)
    lat = np.arcsin(rng.uniform(np.cos(np.radians(radius)), 1, n))
    sigma = 10 ** rng.uniform(0, 2.5, (2, n))
    return Field(rng.uniform(0, 2 * np.pi, n), lat, sigma * rng.normal(size=(2, n)), sigma, rng.uniform(-0.99, 0.99, n))


def main(lmax=3):
    print(f"degree {lmax}, 10 000 sources in a cap about the pole")
    print(f"{'radius':>7} {'condition':>10} {'N':>9} {'b':>9} {'coefficients [σ]':>17} {'σ':>9}")
    for radius in (180, 90, 60, 45, 35, 30, 25, 20):
        direct, compressed = (
            fit.normal_equations(cap(10_000, radius), Modes(lmax), method=m) for m in ("design-matrix", "compressed")
        )
        scale = 1 / np.sqrt(np.diag(direct.matrix))
        condition = np.linalg.cond(direct.matrix * np.outer(scale, scale))
        one, two = (fit.solve(normal, max_condition=1e14) for normal in (direct, compressed))
        differences = (
            np.abs(two.matrix - one.matrix).max() / np.abs(one.matrix).max() for one, two in [(direct, compressed)]
        )
        rhs = np.abs(compressed.rhs - direct.rhs).max() / np.abs(direct.rhs).max()
        moved = np.abs((two.coefficients.values - one.coefficients.values) / one.sigma).max()
        print(f"{radius:6d}° {condition:10.1e} {next(differences):9.0e} {rhs:9.0e} {moved:17.0e} "
              f"{np.abs(two.sigma / one.sigma - 1).max():9.0e}")  # fmt: skip


if __name__ == "__main__":
    main()
