"""
Two catalogues of radio positions
=================================

A reference frame is realised anew about every ten years, from more observations. Is the new realisation rotated or
deformed relative to the old one? The differences of position between two catalogues of the same sources are a vector
field on the sky: its toroidal degree 1 is a rotation of one frame relative to the other, its spheroidal degree 1 a
glide, and degree 2 quadrupole deformations.

With the files of the IERS (icrf3sx.txt, icrf2-all.txt) use ``read_icrf("icrf3sx.txt")``. Here two catalogues are
simulated; the older one is rotated and deformed, and has a few sources that moved because their structure changed.
"""

import numpy as np

import sim
from fit.frames.compare import compare_catalogues
from vsh.conventions import from_icrf3
from vsh.figures.plot import plot_field
from vsh.sky.frames import Positions
from vsh.tools.units import UAS

TRUTH = {"R1": 12.0, "R2": 15.0, "R3": -2.0, "D1": -20.0, "D2": -65.0, "D3": -95.0, "E20": 45.0}  # µas
N = 3400

rng = np.random.default_rng(3)
lon, lat = sim.uniform_sky(N, rng)
sigma = 10 ** rng.uniform(1.5, 3.0, (2, N))  # 30 µas to 1 mas
names = np.array([f"S{i:04d}" for i in range(N)])
differences = from_icrf3(TRUTH).at(lon, lat) + sigma * rng.standard_normal((2, N))
differences[:, -12:] += 12 * sigma[:, -12:]  # twelve sources whose structure moved
newer = Positions(lon, lat, sigma / 30, name=names)
older = Positions(lon - differences[0] * UAS / np.cos(lat), lat - differences[1] * UAS, sigma, name=names)[100:]
newer

# %%
# Matching and outliers
# ---------------------
#
# Sources are matched by designation (``by="position"`` matches within a radius). The covariances of both catalogues
# are added for each difference. Sources that deviate by more than five standard errors are excluded and the fit is
# repeated until nothing changes; the list of these sources is part of the result.
comparison, kept = compare_catalogues(newer, older, 2, labels=("newer", "older"))
print(comparison.report())

# %%
# The parameters of the ICRF3 papers
# ----------------------------------
#
# The papers on ICRF3 (Charlot et al. 2020, A&A 644, A159) call the parameters R (rotation), D (glide), E and M (quadrupoles).
print(f"{'':6}{'[µas]':>8}{'±':>7}{'truth':>8}")
for name, (value, error) in comparison.parameters.items():
    print(f"{name:6}{value:8.1f}{error:7.1f}{TRUTH.get(name, 0.0):8.1f}")

# %%
# Are the errors right?
# ---------------------
#
# χ²/dof shows whether the errors of both catalogues are right. Here they are. For the real ICRF3 and ICRF2 it is 2.8
# with all sources, and 0.8 without those that deviate by more than five errors: a few sources have moved, and the
# errors of the others are somewhat too large. If it exceeds one without outliers, use errors from the scatter: a
# bootstrap over sources, or ``excess_noise``.
print(
    f"χ²/dof {comparison.solution.reduced_chi2:.3f} with {len(kept)} sources; excluded: {', '.join(comparison.names[:6])}, …"
)

# %%
# The glide of 100 µas between ICRF3 and ICRF2 is caused by the acceleration of the Solar System, which ICRF3 takes
# into account and ICRF2 does not, and by errors of the troposphere in the south. The fitted field:
solution = comparison.solution
plot_field(
    kept, solution.coefficients, covariance=solution.covariance, title="newer − older, degrees 1 and 2", unit="µas"
)

# %%
# From the command line::
#
#     vsh-compare icrf3sx.txt icrf2-all.txt --lmax 2 --output comparison --html comparison.html
#
# and, for the defining sources of both, ``--columns format=icrf --where 'defining == "D"'``.
