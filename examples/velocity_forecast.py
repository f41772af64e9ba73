"""
What more galaxies tell of our velocity and of H0
=================================================

Galaxies share flows. Beyond some precision of their motions it is these that limit what is known of our
velocity and of the Hubble constant, and a better catalogue helps little. The acceleration, known from quasars, helps
more; the Local Group's motion lowers the error of our velocity, not that of H0, since the galaxies about us share it.
"""

import matplotlib.pyplot as plt

import sim
from fit.secular_parallax import forecast_velocity, observer_velocity
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

# %%
# Galaxies with the errors of three releases. Motions do not matter for a forecast.
galaxies = sim.galaxies(4_000, rng=1)
nothing = sim.spin((0, 0, 0))
catalogues = {name: sim.observe(galaxies, nothing, rng=2, release=name) for name in ("DR3", "DR4", "DR5")}
found = forecast_velocity(catalogues, n_modes=60)
print(found.report())

# %%
# One sky of DR5, with flows in motions and in redshifts, fitted as if every galaxy moved by itself, and with flows.
ours = CMB_VELOCITY_PLANCK18.to_frame("icrs").value
truth = sim.secular_parallax(ours) + sim.peculiar(150.0, rng=3, flow="linear")
field = sim.observe(galaxies, truth, rng=4, release="DR5", redshifts="cmb", redshift_error="spectroscopic")
field = field[field.redshift > 0.002]
alone = observer_velocity(field, 67.3, flows=None, peculiar_dispersion=306.0).velocity
shared = observer_velocity(field, 67.3)  # flows are fitted unless they are left out
for name, v in (("independent", alone), ("flows", shared.velocity)):
    print(f"{name:12} found − true, in standard errors: {((v.value - ours) / v.sigma).round(2)}")
print(shared.flow.report())

# %%
# The figure: errors of H0 by redshift limit.
found.plot()
plt.savefig("velocity_forecast.png", dpi=300)
