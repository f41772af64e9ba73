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

import sim
from fit.frames.compare import compare_catalogues
from vsh.conventions import from_icrf3
from vsh.figures.plot import plot_field
from vsh.io.catalogue import read_icrf
from vsh.sky.frames import Positions
from vsh.tools.units import UAS

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
# Match them by name and fit the differences, both covariances added, without those beyond five errors.
newer, older = (read_icrf(path, "iers") for path in sys.argv[1:3]) if len(sys.argv) > 2 else simulated()
comparison, kept = compare_catalogues(newer, older, 2, by="name", labels=("newer", "older"))
for note in comparison.solution.notes:
    print(note)

# %%
# Rotation, glide and quadrupoles under the names of the ICRF3 papers.
print(f"{len(kept)} sources kept, χ²/dof {comparison.solution.reduced_chi2:.2f}")
print(f"{'':6}{'[µas]':>8}{'±':>7}")
for name, (value, error) in comparison.parameters.items():
    print(f"{name:6}{value:8.1f}{error:7.1f}" + (f"   truth {TRUTH.get(name, 0.0):.1f}" if len(sys.argv) < 3 else ""))

# %%
# The largest outliers, by name.
for name, (east, north), x in list(zip(comparison.names, comparison.offsets / 1000, comparison.distances, strict=True))[
    :8
]:
    print(f"{name}: {east:+.2f}, {north:+.2f} mas, {x:.0f} times its error")

# %%
# The figure: the differences that were fitted, as arrows. ``vsh-compare`` does all of this from a shell.
solution = comparison.solution
plot_field(
    kept,
    solution.coefficients,
    covariance=solution.covariance,
    title="Differences of position, degrees 1 and 2",
    unit="µas",
)
plt.savefig("compare_catalogues.png", dpi=300)
