"""P-values and coverage of anisotropic expansion in bins of redshift, on skies with systematic errors.

python benchmarks/shear_by_redshift.py gaia 200
python benchmarks/shear_by_redshift.py gaia 200 4 2

Five bins of 240 000 quasars of DR3 outside the Galactic plane, normal equations to degree 5. Systematic errors are of
0.7 µas/yr in a component of the acceleration, of Gaia's published spectrum ("gaia", half of it specific to each bin in
"own"), of a flat one or of l⁻² ("flat", "steep"), or absent ("none"). The last numbers are the norm of the expansion
in the first bin, and by how much it grows from bin to bin [µas/yr]; both are zero unless given.
"""

import sys
from dataclasses import replace

import numpy as np

import fit
import sim
from fit.background import SHAPES
from fit.motions.shear import compare_expansions, from_tensor
from vsh import Modes

BINS, NUMBER, TIMES, LMAX = 5, 20_000, 12, 5


def equations(k):
    """Normal equations of a bin: those of some sources, times as many as there are."""
    quasars = sim.quasars(NUMBER, rng=100 + k, sky="plane-avoiding", max_magnitude=20.5)
    normal = fit.normal_equations(sim.observe(quasars, sim.spin((0, 0, 0)), rng=200 + k, release="DR3"), LMAX)
    return replace(normal, matrix=TIMES * normal.matrix, n_data=TIMES * normal.n_data)


def drawn(normals, variances, common_share, rng, signals=None):
    """Right-hand sides of a sky: signals, systematic errors, a share of them common to the bins, and noise."""
    size = len(variances)
    common, out = rng.normal(size=size), []
    for k, normal in enumerate(normals):
        mixed = np.sqrt(common_share) * common + np.sqrt(1 - common_share) * rng.normal(size=size)
        noise = np.linalg.cholesky(normal.matrix) @ rng.normal(size=size)
        signal = 0.0 if signals is None else signals[k]
        rhs = normal.matrix @ (mixed * np.sqrt(variances) + signal) + noise
        chi2 = rng.chisquare(normal.n_data - size) + rhs @ np.linalg.solve(normal.matrix, rhs)
        out.append(replace(normal, rhs=rhs, chi2_null=float(chi2)))
    return out


def main(kind, number, norm=0.0, step=0.0):
    """Print the fraction of p-values below 0.05 and 0.0027, and the coverage of components and limits."""
    normals, modes = [equations(k) for k in range(BINS)], Modes(LMAX)
    spectrum = SHAPES[{"own": "gaia", "none": "flat"}.get(kind, kind)]
    variances = spectrum.variances(modes) * (0.0 if kind == "none" else (0.7 / spectrum.acceleration_error) ** 2)
    shape = np.diag([2.0, -1.0, -1.0]) / np.sqrt(6)
    tensors = [(norm + k * step) * shape for k in range(BINS)]
    signals = [from_tensor(tensor).to_degree(LMAX).values for tensor in tensors]
    rows, pulls, limits = [], [], []
    for seed in range(number):
        sky = drawn(normals, variances, 0.5 if kind == "own" else 1.0, np.random.default_rng(seed), signals)
        result = compare_expansions(sky, 0.5 + 0.5 * np.arange(BINS), draws=200, rng=seed)
        rows.append([result.p_value(0), result.p_value(2), result.equality(), result.growth(), result.formal[0]])
        for k in (0, 2):
            shear = result.shears[k]
            truth = tensors[k][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            pulls.append((shear.values - truth) / shear.sigma)
            limits.append(shear.limit() > np.linalg.norm(tensors[k]))
    p = np.array(rows)
    names = ("first bin", "third bin", "equal tensors", "growth", "first bin, formal")
    print(f"{kind}, |Σ| = {norm:g} + {step:g} a bin, {number} skies; P(p < 0.05), P(p < 0.0027):")
    for name, column in zip(names, p.T, strict=True):
        print(f"  {name:20}{np.mean(column < 0.05):7.3f}{np.mean(column < 0.0027):8.4f}")
    inside = [np.mean(np.abs(pulls) < bound) for bound in (1.0, 1.96)]
    print(
        f"  components: pull {np.std(pulls):.3f}, within 1 σ {inside[0]:.3f}, within 1.96 σ {inside[1]:.3f}; ", end=""
    )
    print(f"95 % limits above the truth {np.mean(limits):.3f}")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *map(float, sys.argv[3:5]))
