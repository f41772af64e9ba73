"""
The growth of structure from motions and density
================================================

Galaxies fall towards where there are more of them, at a speed that tells how fast structure grows. Proper motions see that part
of the fall that is across the line of sight: their cross-correlation with the density of galaxies gives f/b, the growth rate over the
bias, or a limit on it.
"""

import matplotlib.pyplot as plt
import numpy as np

import sim
from fit.motions.growth import growth
from vsh.figures.plot import figure_of
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import flow_of_galaxies
from vsh.sky.sphere import triad

# %%
# Ten thousand galaxies out to 90 Mpc/h whose density follows matter, and their true velocities.
population, truth = sim.clustered_galaxies(10_000, 4, size=96)
distance = transverse_distance(population.redshift) * hubble_value(FLAT_PLANCK13) / 100  # [Mpc/h]

# %%
# The flow that linear theory has for the density, smoothed with 8 Mpc/h.
flow = flow_of_galaxies(population.lon, population.lat, distance)

# %%
# A slice through the middle: galaxies, and the flow.
positions = triad(population.lon, population.lat)[2] * distance
in_slice = np.abs(positions[2]) < 8
fig, ax = plt.subplots(figsize=(6, 5.6), layout="constrained")
ax.plot(*positions[:2, in_slice], ".", ms=2, color="0.6")
grid = np.linspace(-80, 80, 21)
x, y = (each.ravel() for each in np.meshgrid(grid, grid))
velocity, _ = flow.at(np.arctan2(y, x), np.zeros_like(x), np.hypot(x, y), "icrs")
arrows = ax.quiver(x, y, *velocity[:2], color="C0", scale=9000, width=0.003)
ax.quiverkey(arrows, 0.84, 0.96, 500, "500 km/s", labelpos="E", coordinates="axes")
ax.set_aspect("equal")
ax.set_xlabel("x [Mpc/h]")
ax.set_ylabel("y [Mpc/h]")
figure_of(ax).savefig("growth_flow.png")

# %%
# Motions with errors of 30 µas/yr, as of many galaxies in Gaia DR5 were they points: the truth is 0.526.
field = sim.observe(
    population, sim.peculiar(200.0, 5, flow=truth) + sim.acceleration((-0.2, -3.8, -2.1)), 6, sigma=30.0
)
result = growth(field, flow)
print(result.report())
