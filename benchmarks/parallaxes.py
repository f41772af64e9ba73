"""Coverage of the mean and the dipole of parallaxes by `fit.recommended`, on skies with and without systematic errors.

    python benchmarks/parallaxes.py [SKIES]

For each kind of sky: rms pull of the mean and of the dipole's components, how many lie within 1 and 1.96 errors, and how
often p-values that two classes of magnitude have the same mean and dipole are below 0.05 and 0.0027. The truth has a mean
of −21 µas and a dipole; the systematic errors, from degree 0 on and common to the classes, belong to the errors. Then the
same without classes, five times as many skies, for least squares with a floor whose spectrum is the one that was drawn:
what the error bars are worth where the spectrum is known.
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
    """Deviations of the mean and of the dipole in their errors, (4,), and the p-value of equal classes."""
    field = parallaxes(np.random.default_rng(seed), **sky)
    result = fit.recommended(field)
    (value, error), dipole = result.mean, result.dipole
    p_value = np.nan
    if result.modes.lmax >= 3:
        precise = field.sigma < np.median(field.sigma)
        normals = [result.equations(part, result.modes.lmax) for part in (field[precise], field[~precise])]
        p_value = fit.background.shared(normals, draws=100, noise_scale=False).verdict(n=2000).p_value
    return [(value - MEAN) / error, *((dipole.value - DIPOLE) / dipole.sigma), p_value]


def pulls_of_known_spectrum(seed, shape):
    """Deviations of the mean and of the dipole in their errors, (4,), with a floor of the spectrum that was drawn."""
    normal = fit.normal_equations(parallaxes(np.random.default_rng(seed), shape), 5)
    result = fit.solve(normal, floor=fit.background.floor(normal, shapes=shape[:1], noise_scale=False))
    (value, error), dipole = result.mean, result.dipole
    return [(value - MEAN) / error, *((dipole.value - DIPOLE) / dipole.sigma)]


def print_row(name, found, further=""):
    """Print rms pulls and coverage of the mean and of the dipole, from pulls of skies, (k, 4)."""
    mean, dipole = found[:, 0], found[:, 1:4]
    rms = [np.sqrt(np.mean(x**2)) for x in (mean, dipole)]
    within = [[np.mean(np.abs(x) < k) for x in (mean, dipole)] for k in (1, 1.96)]
    cells = "    ".join(f"{a:.3f} {b:.3f}" for a, b in within)
    print(f"{name:26} {rms[0]:.2f} {rms[1]:.2f}    {cells}    {further}", flush=True)


def main(n_skies=300):
    """Print a row for each kind of sky."""
    print("sky                        rms of mean, dipole    within 1 σ    within 1.96 σ    classes: p < 0.05, 0.0027")
    kinds = {name: {"shape": shape} for name, shape in SKIES.items()}
    kinds["Student's t, ν = 3"] = {"tails": True}
    kinds["100 sources"] = {"n": 100}
    with ProcessPoolExecutor() as pool:
        for name, sky in kinds.items():
            found = np.array(list(pool.map(partial(pulls, **sky), range(n_skies))))
            p_values = found[:, 4]
            small = " ".join(
                "–" if np.isnan(p_values).any() else f"{np.mean(p_values < p):.3f}" for p in (0.05, 0.0027)
            )
            print_row(name, found, small)
        print("the spectrum known:")
        for name, shape in SKIES.items():
            if shape is not None:
                known = partial(pulls_of_known_spectrum, shape=shape)
                print_row(name, np.array(list(pool.map(known, range(5 * n_skies), chunksize=20))))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
