"""
A zero point that is not the same everywhere
============================================

Quasars have no parallax that Gaia could see: what it measures is its own zero point. Here it is a scalar field with a
mean, a dipole and some structure, seen through errors a hundred times as large in each source. The recommended fit serves it
as it serves motions: a few parallaxes are wrong by far, and the structure is a systematic error of mean and dipole.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from sim.astrometry import parallax_error
from vsh import ScalarCoefficients, ScalarField, ScalarModes

# %%
# The truth: −21 µas on average, a dipole, and a random field of degrees 2 to 6 of some 3 µas.
rng, lmax = np.random.default_rng(1), 6
modes = ScalarModes(lmax)
structure = np.where(modes.degrees > 1, rng.normal(0, 1.5, len(modes)), 0.0)
truth = ScalarCoefficients.from_moments(mean=-21.0, dipole=(4.0, -2.0, 6.0), lmax=lmax) + ScalarCoefficients(
    modes, structure
)

# %%
# 400 000 quasars behind no Galactic plane, with Gaia's errors; one in 500 is wrong by ten times its error.
quasars = sim.quasars(400_000, rng=2, sky="plane-avoiding", max_magnitude=20.5)
sigma = parallax_error(quasars.magnitude, "DR3")
wrong = np.where(rng.random(len(quasars)) < 0.002, 10.0, 1.0)
parallax = truth.at(quasars.lon, quasars.lat) + wrong * sigma * rng.standard_normal(len(quasars))
field = ScalarField(quasars.lon, quasars.lat, parallax, sigma, unit="µas")

# %%
# The fit, and how far it is from the truth in its own errors.
solution = fit.recommended(field, lmax).solution
value, error = solution.mean
print(f"mean {value:+.2f} ± {error:.2f} µas, truth −21")
for name, found, spread, true in zip("xyz", solution.dipole.value, solution.dipole.sigma, (4, -2, 6), strict=True):
    print(f"dipole {name} {found:+.2f} ± {spread:.2f} µas, truth {true:+d}")
pulls = (solution.values - truth.values)[:4] / solution.sigma[:4]
print(f"found − true in errors: rms {np.sqrt(np.mean(pulls**2)):.2f}, largest {np.abs(pulls).max():.2f}")

# %%
# Degree by degree, and on the sky.
print(solution.report())
figures = fit.output.draw_figures(solution, field)
figures["spectrum"].figure.savefig("parallax_spectrum.png", dpi=300)
figures["sky"].figure.savefig("parallax_zero_point.png", dpi=300)
plt.show()
