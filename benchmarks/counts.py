"""Coverage of the dipole of number counts by `fit.recommended`, behind a mask and a selection, with higher degrees or not.

    python benchmarks/counts.py [SKIES]

For each kind of sky: the mean of the dipole along its truth, the rms pull of its components and how many lie within 1 and
1.96 errors, for `fit.recommended`; then rms pull and coverage for a plain fit of mean and dipole alone. A million sources
outside of the Galactic plane, seen through a selection that varies by a factor of two; the dipole is (0.003, −0.006, 0.002).
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import fit
from fit.background import SCALAR_SHAPES
from vsh import ScalarCoefficients, ScalarField, ScalarModes
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad

N_SOURCES, NSIDE, LMAX = 1_000_000, 32, 8
DIPOLE = np.array([0.003, -0.006, 0.002])
#: Root of the power of each mode: of the octopole alone, or of degree 2 with the others in the proportions of Gaia's spectrum.
SKIES = {
    "dipole alone": {},
    "octopole of 0.004 a mode": {"octopole": 0.004},
    "power of every degree": {"power": 0.004},
    "the same, no dipole": {"power": 0.004, "has_dipole": False},
}


def pulls(seed, octopole=0.0, power=0.0, has_dipole=True):
    """Values along the truth [truth = 1], and pulls of the dipole, (2, 4): recommended, and mean and dipole alone."""
    rng = np.random.default_rng(seed)
    lon, lat = centres(NSIDE)
    direction = triad(lon, lat)[2].T
    selection = (1.5 + 0.5 * np.sin(lon)) * (np.abs(direction @ rotation_matrix("icrs", "galactic")[2]) > 0.3)
    modes, truth = ScalarModes(LMAX), DIPOLE * has_dipole
    l = modes.degrees
    values = rng.normal(size=len(modes)) * np.where(l == 3, octopole, 0.0)
    if power:
        variances = SCALAR_SHAPES["gaia"].variances(modes)
        values += power * rng.normal(size=len(modes)) * np.sqrt(variances / variances[l == 2].mean())
    density = 1 + direction @ truth + ScalarCoefficients(modes, values).at(lon, lat)
    expected = selection * density
    counts = rng.poisson(N_SOURCES * expected / expected.sum())
    field = ScalarField.from_counts(np.repeat(lon, counts), np.repeat(lat, counts), 16, selection)
    found = []
    for result in (fit.recommended(field), fit.fit_field(field, 1)):
        dipole = result.dipole
        found.append([dipole.value @ DIPOLE / (DIPOLE @ DIPOLE), *((dipole.value - truth) / dipole.sigma)])
    return found


def main(n_skies=300):
    """Print a row for each kind of sky."""
    print("sky                        along truth, rms pull, within 1 and 1.96 σ: recommended    mean and dipole alone")
    with ProcessPoolExecutor() as pool:
        for name, sky in SKIES.items():
            found = np.array(list(pool.map(partial(pulls, **sky), range(n_skies), chunksize=5)))
            cells = []
            for values in found.transpose(1, 0, 2):
                x = values[:, 1:]
                cells.append(
                    f"{values[:, 0].mean():+.2f} ± {values[:, 0].std() / np.sqrt(n_skies):.2f}  {np.sqrt(np.mean(x**2)):.2f}"
                    f"  {np.mean(np.abs(x) < 1):.3f} {np.mean(np.abs(x) < 1.96):.3f}"
                )
            print(f"{name:26} {'    '.join(cells)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
