"""
The acceleration from a table of Gaia
=====================================

Quasars are so distant that they should show no proper motion. In the catalogue of Gaia they do, by about five
microarcseconds per year towards a point near the centre of our Galaxy: the Solar System is accelerated in this
direction, and the direction in which we see a source changes with our velocity. This tutorial measures the
acceleration as Gaia Collaboration, Klioner et al. (2021, A&A 649, A9) did, from a table with the columns of the Gaia
archive, and checks at each step what could be wrong.

With a network connection, ``vsh-archive gaia-crf3 --output crf3.fits`` downloads the real table. Here a table is
simulated, so that the truth is known: an acceleration of 5.05 µas/yr towards the Galactic centre, and a frame that
rotates.
"""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import fit
import sim
from fit.results.output import plot_spectrum
from vsh.figures.plot import plot_field
from vsh.io.catalogue import read_field

TRUE_ACCELERATION = np.array((-0.277, -4.411, -2.443))  # 5.05 µas/yr towards the Galactic centre, ICRS axes
TRUE_SPIN = np.array((0.5, -1.0, 0.3))

folder = Path(mkdtemp())
table = sim.crf3(1, sim.acceleration(TRUE_ACCELERATION) + sim.spin(TRUE_SPIN), n_five=300_000)
table.write(folder / "crf3.fits")
table["ra", "dec", "pmra", "pmdec", "pmra_error"][:5]

# %%
# Reading
# -------
#
# ``read_field`` recognises the column names and units of the Gaia archive. A row that cannot be used raises an error
# by default; with ``on_bad="drop"`` it is left out, and the notes of the field count such rows by reason. In this
# table they are the sources without a proper motion (two-parameter solutions). Six-parameter solutions, in which the
# colour of the source was fitted as well, are used.
field = read_field(folder / "crf3.fits", on_bad="drop")
for note in field.notes:
    print(note)
field

# %%
# A first fit
# -----------
#
# Degree 1 contains the two vectors that we want: the three components of the spin (toroidal) and the three of the
# acceleration (spheroidal). The report lists them with their errors. A second solver, which has no formula in common
# with the first, checks the result.
solution = fit.fit_field(field, 1)
print(solution.report(check=fit.cross_check(field), source="crf3.fits"))

# %%
# Are the errors right?
# ---------------------
#
# Three questions decide whether the errors above can be trusted.
#
# *Is there signal in higher degrees?* A fit to a higher degree gives the power of each degree, and the probability
# that noise alone gives as much. In this table only degree 1 has significant power. In the real table higher degrees
# have some, because the scanning law leaves systematic errors.
solution = fit.fit_field(field, 4)
plot_spectrum(solution)

# %%
# *Are there systematic errors?* Errors that neighbouring sources have in common do not decrease with the number of
# sources, and the formal errors do not include them. They are estimated from the power of degrees 2 and higher, and
# extrapolated to the spin and the acceleration: the systematic floor. See :doc:`errors_that_stay`.
floor = fit.background.floor(fit.normal_equations(field, 4))
print(floor.report())

# %%
# *Are there outliers?* Source structure, companions and wrong identifications cause motions that are not noise.
# ``fit.robust.clip`` leaves out the sources that deviate from the fit by more than five times the median deviation.
# If the result changes by more than its error, examine the sources that were clipped.
clipped = fit.robust.clip(field, 4, kappa=5)
moved = clipped.solution.acceleration.value - solution.acceleration.value
print(
    f"{clipped.n_clipped} of {len(field)} sources clipped; the acceleration moves by {np.abs(moved).max():.2f} µas/yr"
)

# %%
# What to publish
# ---------------
#
# Publish the vector with its covariance, in the frame that readers expect. In Galactic axes almost all of the
# acceleration should be in the first component.
acceleration = solution.acceleration.to_frame("galactic")
acceleration

# %%
# Only here is the truth known:
pulls = (solution.acceleration.value - TRUE_ACCELERATION) / solution.acceleration.sigma
print("(estimate − truth) / error:", pulls.round(1))

# %%
# The map in Galactic coordinates: the colour of an arrow shows its significance; regions without sources are hatched.
galactic = fit.fit_field(field.to_frame("galactic"), 1)
plot_field(
    field.to_frame("galactic"), galactic.coefficients, covariance=galactic.covariance, title="Proper motions of quasars"
)

# %%
# The same from the command line::
#
#     vsh-fit crf3.fits --on-bad drop --frame galactic --output results --html results.html
#
# ``results/run.toml`` repeats the run, and ``results/citation.bib`` lists the publications to cite.
