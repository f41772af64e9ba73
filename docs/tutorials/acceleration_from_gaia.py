"""
The acceleration from a table of Gaia
=====================================

Quasars are so far that none of them should move. In Gaia's catalogue they do, by some five microarcseconds a year, all towards one point
near the centre of our Galaxy: the Solar System is accelerated towards it, and the direction in which we see a source shifts as our velocity
changes. This page measures that acceleration as Gaia Collaboration, Klioner et al. (2021, A&A 649, A9) did, from a table in the archive's own
columns, and looks at every step at what could be wrong.

With a network, ``vsh-archive gaia-crf3 --output crf3.fits`` fetches the real table. Here one is simulated, so that the truth is known: an
acceleration of 5.05 µas/yr towards the Galactic centre and a frame that spins.
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
# ``read_field`` knows Gaia's names and units. A row that cannot be used is an error unless you say what to do about it; with
# ``on_bad="drop"`` the field's notes count what was left out, and why. Here that is what the archive has no motion for. Solutions with two
# parameters have none; those with six have a colour that was fitted as well, and are used.
field = read_field(folder / "crf3.fits", on_bad="drop")
for note in field.notes:
    print(note)
field

# %%
# A first fit
# -----------
#
# Degree 1 holds just what we are after: three components of the spin (toroidal), three of the acceleration (spheroidal). The report puts
# their errors beside them, and a second solver, which shares no formula with the first, checks the result.
solution = fit.fit_field(field, 1)
print(solution.report(check=fit.cross_check(field), source="crf3.fits"))

# %%
# What the catalogue does not say
# -------------------------------
#
# Two things decide whether the errors above are the true ones.
#
# *Are there more patterns than two?* A fit to a higher degree tells: the power of a degree, with the chance that noise alone gives as much. In
# this table there are none but those of degree 1. In the real one there are, small ones: the scanning law leaves traces.
solution = fit.fit_field(field, 4)
plot_spectrum(solution)

# %%
# *Do sources share errors?* What they share does not fall with their number, and no formal error knows of it. The power of degrees 2 and
# higher is the only witness: from it the floor is estimated under spin and acceleration. :doc:`errors_that_stay` is about this.
floor = fit.background.floor(fit.normal_equations(field, 4))
print(floor.report())

# %%
# *And outliers?* Structure, companions and wrong identifications make motions that are no noise. ``fit.robust.clip`` leaves out what lies
# farther from the fit than five times the median; if the result moves by more than its error, look at what was clipped.
clipped = fit.robust.clip(field, 4, kappa=5)
moved = clipped.solution.acceleration.value - solution.acceleration.value
print(
    f"{clipped.n_clipped} of {len(field)} sources clipped; the acceleration moves by {np.abs(moved).max():.2f} µas/yr"
)

# %%
# What to publish
# ---------------
#
# A vector with its covariance, in the frame people think in. Along Galactic axes almost all of it should be in the first component.
acceleration = solution.acceleration.to_frame("galactic")
acceleration

# %%
# The truth, of course, is known only here:
pulls = (solution.acceleration.value - TRUE_ACCELERATION) / solution.acceleration.sigma
print("found − true, in errors:", pulls.round(1))

# %%
# The map, in Galactic coordinates: arrows are coloured by how sure they are, and hatched is where no source stands.
galactic = fit.fit_field(field.to_frame("galactic"), 1)
plot_field(
    field.to_frame("galactic"),
    galactic.coefficients,
    covariance=galactic.covariance,
    title="What the sky of quasars does",
)

# %%
# From a shell all of it is one line::
#
#     vsh-fit crf3.fits --on-bad drop --frame galactic --output results --html results.html
#
# ``results/run.toml`` repeats the run, ``results/citation.bib`` says whom to cite.
