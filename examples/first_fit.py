"""
A first fit
===========

Simulate ten thousand quasars as Gaia sees them, in a frame that spins, seen from a Solar
System that accelerates; fit; and see both come out. The direct frame solver, which shares
no formula with the harmonics, must say the same.
"""

import matplotlib.pyplot as plt

import fit
import sim
from vsh import Modes, Vector
from vsh.figures.plot import plot_field

# %%
# The truth: a spin of 3 µas/yr about the pole, and the Solar System drawn to the Galactic
# centre by 5.05 µas/yr. Positions avoid the Galactic plane; errors are those of Gaia DR5.
TRUE_SPIN = (0.0, 0.0, 3.0)
TRUE_ACCELERATION = Vector([5.05, 0, 0], [[0, 0, 0]] * 3, frame="galactic").to_frame("icrs").value

quasars = sim.quasars(10_000, rng=1, sky="plane-avoiding", max_magnitude=19)
field = sim.observe(quasars, sim.spin(TRUE_SPIN) + sim.acceleration(TRUE_ACCELERATION), rng=2, rho=0.2, release="DR5")

# %%
# The fit: normal equations of all modes to degree 3, solved. Everything follows from the
# solution.
solution = fit.solve(fit.normal_equations(field, Modes(3)))
check = fit.cross_check(field)
print(solution.report(check=check))

for name, found, true in (
    ("spin", solution.spin, TRUE_SPIN),
    ("acceleration", solution.acceleration, TRUE_ACCELERATION),
):
    pulls = (found.value - true) / found.sigma
    print(f"{name:13} found − true, in standard errors: {pulls.round(2)}")
print(f"both solvers agree to {check.largest:.0e} standard errors")

# %%
# The figure: the sources, and the field that was fitted to them.
plot_field(field, solution.coefficients, covariance=solution.covariance, title="A sky that turns and flows")
plt.savefig("first_fit.png", dpi=300)
