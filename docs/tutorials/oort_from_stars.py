"""
Oort's constants from a star catalogue
======================================

Stars near the Sun show a mean streaming motion, because the Sun moves, and the motion changes with position, because
the Galaxy rotates differentially. To first order in the distance, four numbers describe the change in the Galactic
plane: the Oort constants A (shear) and B (rotation), and C and K, which are zero for circular orbits. Proper motions
and parallaxes are sufficient to measure them.

With a file of your own: ``fit.kinematics(vsh.read_field("stars.fits"))``. Here a catalogue is simulated, so that the
truth is known.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
from vsh import Field
from vsh.figures.plot import COLOURS, STYLE
from vsh.sky.sphere import triad
from vsh.tools.units import AU_PER_YEAR

# %%
# The density of stars decreases as exp(−d/L) with L = 300 pc; velocity dispersions are 35, 25 and 20 km/s; A = 15.3,
# B = −11.9, C = −3.2 and K = −3.3 km/s/kpc are the values of Bovy (2017). The error of the parallaxes is 0.3 mas, so
# that a third of them have less than 5 standard errors.
TRUTH = {"A": 15.3, "B": -11.9, "C": -3.2, "K": -3.3}
SUN = np.array([11.1, 12.24, 7.25])
rng = np.random.default_rng(1)
n = 60_000
distance = rng.gamma(3.0, 0.3, n)  # kpc
lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
p, q, r = triad(lon, lat)
a, b, c, k = TRUTH.values()
gradient = np.array([[k + c, a - b, 0], [a + b, k - c, 0], [0, 0, 0]])
velocity = -SUN[:, None] + gradient @ (r * distance) + rng.normal(size=(3, n)) * np.array([[35.0], [25.0], [20.0]])
motion = np.stack([np.sum(p * velocity, 0), np.sum(q * velocity, 0)]) / (AU_PER_YEAR * distance / 1000)  # µas/yr
sigma = np.full((2, n), 100.0)
parallax = 1 / distance + 0.3 * rng.normal(size=n)  # mas
stars = Field(
    lon,
    lat,
    motion + sigma * rng.normal(size=(2, n)),
    sigma,
    frame="galactic",
    parallax=parallax,
    parallax_error=np.full(n, 0.3),
)

# %%
# The fit needs no cut in parallax, which would select stars by their errors and bias the result. Instead of
# 1/parallax it uses the expectation of 1/d given the parallax, negative ones included, with the scale length
# estimated from the catalogue.
solution = fit.kinematics(stars)
print(solution.report())

# %%
# In the plane, A and B are a sine wave and an offset in longitude: µ_l = (A cos 2l + B)/4.74, in addition to the
# effect of our own motion.
plt.rcParams.update(STYLE)
figure, axes = plt.subplots()
names = list(TRUTH)
values = np.array([solution.oort[name] for name in names])
axes.errorbar(names, values[:, 0], values[:, 1], fmt="o", color=COLOURS[0], label="fit")
axes.plot(names, list(TRUTH.values()), "_", markersize=12, color=COLOURS[1], label="truth", zorder=3)
axes.axhline(0, color="0.7", linewidth=0.8)
axes.margins(x=0.15)
axes.set_ylabel("Oort constant  [km/s/kpc]")
axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
