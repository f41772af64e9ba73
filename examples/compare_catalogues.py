"""
Two catalogues of one sky
=========================

Run as ``python compare_catalogues.py ICRF3 ICRF2`` with the two catalogues of VLBI positions as the
IERS hands them round (icrf3sx.txt, icrf2-all.txt). Sources are matched by designation; a rotation,
a glide and the quadrupoles of the differences are fitted and printed under ICRF3's names. Without
files, two small catalogues are simulated, the second turned and strained by known amounts.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from vsh import Modes
from vsh.catalogue import match, read_icrf
from vsh.conventions import ICRF3, from_icrf3, to_icrf3
from vsh.sky.plot import plot_field
from vsh.sky.positions import Positions
from vsh.units import UAS

TRUTH = {"R1": 12.0, "R2": 15.0, "R3": -2.0, "D1": -20.0, "D2": -65.0, "D3": -95.0, "E20": 45.0}


def simulated(n=3000):
    """A catalogue, and the same sources as an older one had them."""
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(1.5, 3, (2, n))
    name = np.array([f"S{i:04d}" for i in range(n)])
    offset = from_icrf3(TRUTH).at(lon, lat) + sigma * rng.standard_normal((2, n))
    older = Positions(lon - offset[0] * UAS / np.cos(lat), lat - offset[1] * UAS, sigma, name=name)
    return Positions(lon, lat, sigma / 30, name=name), older[: n - 100]


# %%
# Match them; the notes count what was matched and what is left over.
newer, older = (read_icrf(path, "iers") for path in sys.argv[1:3]) if len(sys.argv) > 2 else simulated()
differences = match(newer, older, by="name")
for note in differences.notes:
    print(note)

# %%
# Some positions are wrong by far more than their errors: a fit that leaves out what lies beyond 5 σ.
clipped = fit.robust.clip(differences, Modes(2), threshold=5.0)
solution = clipped.solution
print(f"{clipped.kept.sum()} sources kept, χ²/dof {solution.reduced_chi2:.2f}")
found = to_icrf3(solution.coefficients)
print(f"{'':6}{'[µas]':>8}{'±':>7}")
for name, value in found.items():
    mode, factor = ICRF3[name]
    error = solution.sigma[solution.modes.index(mode)] / abs(factor)
    print(f"{name:6}{value:8.1f}{error:7.1f}" + (f"   truth {TRUTH.get(name, 0.0):.1f}" if len(sys.argv) < 3 else ""))

# %%
# The largest outliers, by name.
x = np.sqrt(solution.residuals(differences).chi2)
for i in np.argsort(-x)[:8]:
    east, north = differences.motion[:, i] / 1000
    print(f"{differences.name[i]}: {east:+.2f}, {north:+.2f} mas, {x[i]:.0f} times its error")

# %%
# The figure: the differences that were fitted, as arrows.
figure = plot_field(
    differences[clipped.kept], solution.coefficients, title="Differences of position, degrees 1 and 2", unit="µas"
)
plt.savefig("compare_catalogues.png", dpi=150)
