"""Coverage of the mean and the dipole of parallaxes by `fit.recommended`, on skies with and without systematic errors.

    python benchmarks/parallaxes.py [SKIES]

For each kind of sky: rms pull of the mean and of the dipole's components, and how many lie within 1 and 1.96 errors.
The truth has a mean of −21 µas and a dipole; the systematic errors, from degree 0 on, belong to the errors.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import fit
import sim
from fit.background import SCALAR_SHAPES
from vsh import ScalarCoefficients, ScalarField, ScalarModes

LMAX = 12
MEAN, DIPOLE = -21.0, np.array([4.0, -2.0, 6.0])
#: Factors on the spectra: of Gaia's, the published one and nine times its power.
SKIES = {
    "no systematic errors": None,
    "Gaia EDR3's spectrum": ("gaia", 1.0),
    "nine times its power": ("gaia", 9.0),
    "flat spectrum": ("flat", 60.0),
    "steep spectrum": ("steep", 300.0),
}


def parallaxes(rng, shape=None, n=4000, tails=False):
    """Quasars outside of the Galactic plane with errors of 100 to 1000 µas."""
    quasars = sim.quasars(n, rng, "plane-avoiding")
    sigma = 250 * rng.lognormal(0, 0.6, n)
    truth = ScalarCoefficients.from_moments(mean=MEAN, dipole=DIPOLE, lmax=LMAX)
    if shape is not None:
        name, factor = shape
        modes = ScalarModes(LMAX)
        variances = factor * SCALAR_SHAPES[name].variances(modes)
        truth = truth + ScalarCoefficients(modes, rng.normal(size=len(modes)) * np.sqrt(variances))
    noise = rng.standard_t(3, n) if tails else rng.normal(size=n)
    return ScalarField(quasars.lon, quasars.lat, truth.at(quasars.lon, quasars.lat) + sigma * noise, sigma, "µas")


def pulls(seed, **sky):
    """Deviations of the mean and of the dipole in their errors, (4,), and the p-value of the truth's dipole."""
    solution = fit.recommended(parallaxes(np.random.default_rng(seed), **sky)).solution
    value, error = solution.mean
    off = solution.dipole.value - DIPOLE
    return [(value - MEAN) / error, *(off / solution.dipole.sigma)]


def main(n_skies=300):
    """Print a row for each kind of sky."""
    print("sky                        rms of mean, dipole    within 1 σ    within 1.96 σ")
    kinds = {name: {"shape": shape} for name, shape in SKIES.items()}
    kinds["Student's t, ν = 3"] = {"tails": True}
    kinds["100 sources"] = {"n": 100}
    with ProcessPoolExecutor() as pool:
        for name, sky in kinds.items():
            found = np.array(list(pool.map(partial(pulls, **sky), range(n_skies))))
            rms = [np.sqrt(np.mean(found[:, 0] ** 2)), np.sqrt(np.mean(found[:, 1:] ** 2))]
            within = [[np.mean(np.abs(x) < k) for x in (found[:, 0], found[:, 1:])] for k in (1, 1.96)]
            print(f"{name:26} {rms[0]:.2f} {rms[1]:.2f}    " + "    ".join(f"{a:.3f} {b:.3f}" for a, b in within))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
