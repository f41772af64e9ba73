"""
Dipoles in bins of redshift
===========================

The acceleration of the Solar System moves every source alike; our motion through the Universe
moves near ones more, and so do coherent flows. Galaxies and quasars with all three, and
a frame that spins, are cut into bins of redshift: what do the bins say of each?
"""

import matplotlib.pyplot as plt
import numpy as np

import sim
from fit.redshift import binned
from vsh import Field
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

# %%
# The truth: 5 µas/yr towards the Galactic centre, a spin, and Planck's velocity; errors are those
# that a ten times better Gaia would have, so that a hundred thousand galaxies suffice to see it.
truth = (
    sim.acceleration((-0.28, -4.41, -2.44))
    + sim.spin((0.3, 0.0, -0.5))
    + sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value)
    + sim.peculiar(150.0, rng=5, flow="linear")
)
galaxies = sim.observe(sim.galaxies(100_000, rng=1), truth, rng=2, sigma=20.0)
quasars = sim.observe(sim.quasars(50_000, rng=3), truth, rng=4, sigma=60.0)

# %%
# One catalogue of both: the columns of two fields, side by side.
both = Field(
    *(
        np.concatenate([getattr(f, name) for f in (galaxies, quasars)], axis=-1)
        for name in ("lon", "lat", "motion", "sigma")
    ),
    redshift=np.concatenate([galaxies.redshift, quasars.redshift]),
)
bins = binned(both, modes=1, edges=[0.001, 0.004, 0.007, 0.011, 0.02, 0.03, 1.0, 5.0])
print(bins.report())

# %%
# Do the bins agree? Errors and p-values hold the flow, which moves neighbours together and does not average out.
# As if every galaxy moved by itself (``flows=None``), the same bins contradict even what is true.
alone = binned(both, modes=1, edges=bins.edges, flows=None)
for name, each in (("with flows", bins), ("without", alone)):
    spin, acceleration = each.equality("T").p_value, each.equality("S").p_value
    true = each.secular_parallax(CMB_VELOCITY_PLANCK18)[1].p_value
    print(
        f"{name:12} spin alike: p-value {spin:.2g}; acceleration alike: {acceleration:.2g}; constant ã − v/d, which is true: {true:.2g}"
    )

# %%
# The figure: dashed, the prediction for Planck's velocity.
bins.plot()
plt.savefig("redshift_dipoles.png", dpi=300)
