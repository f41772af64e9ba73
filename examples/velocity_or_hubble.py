"""
Our velocity, or the Hubble constant
====================================

Galaxies move by our velocity over their distance, v H0/(c z): their motions know the
product. With H0 known they measure v; with v known from the microwave background they measure
H0; with neither, only the product, along which a posterior is a ridge. Galaxies share flows, which are fitted along and are
nearly the whole error.
"""

import matplotlib.pyplot as plt

import sim
from fit.posterior import Flat, Normal, grid, sample
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

# %%
# The truth: Planck's velocity, H0 = 70, galaxies that share flows of linear theory and move by 150 km/s beside them.
truth = (
    sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value, hubble=70.0)
    + sim.peculiar(150.0, rng=1, flow="linear", hubble=70.0)
    + sim.acceleration((-0.28, -4.41, -2.44))
)
field = sim.observe(sim.galaxies(5_000, rng=2), truth, rng=6, sigma=8.0)

# %%
# Either, by least squares.
velocity = observer_velocity(field, hubble=70.0)
hubble = hubble_constant(field, CMB_VELOCITY_PLANCK18)
print(velocity.report())
print(hubble.report())
pulls = (velocity.velocity.value - CMB_VELOCITY_PLANCK18.to_frame("icrs").value) / velocity.velocity.sigma
print("velocity: found − true, in standard errors:", pulls.round(2))
print(f"H0:       found − true, in standard errors: [{(hubble.hubble - 70.0) / hubble.hubble_error:.2f}]")

# %%
# Both, by their posterior: the velocity as Planck has it, H0 flat, the dispersion of the galaxies beside the flow
# free within 150 ± 50 km/s. Their scatter is then a second ruler of H0. A grid must agree.
given = {
    "velocity_prior": CMB_VELOCITY_PLANCK18,
    "hubble_prior": Flat(20, 150),
    "peculiar_dispersion": Normal(150, 50, low=1.0),
}
posterior = sample(field, n_samples=60_000, rng=4, **given)
print(posterior.report())
on_grid = grid(field, **given)
print(f"H0 from the chain: {posterior.samples['H0'].mean():.2f} ± {posterior.samples['H0'].std():.2f} km/s/Mpc")
print(f"H0 on a grid:      {on_grid.mean('H0'):.2f} ± {on_grid.sigma('H0'):.2f} km/s/Mpc")

# %%
# The figure: every pair of parameters.
posterior.corner(["H0", "peculiar_dispersion", "a_x", "a_y", "a_z"])
plt.savefig("velocity_or_hubble.png", dpi=300)
