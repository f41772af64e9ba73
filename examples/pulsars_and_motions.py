"""
Gravitational waves in pulsars and in motions
=============================================

A gravitational wave shifts the frequency of pulsars and deflects the light of quasars by the same strain at the Earth. Pulsars tell
of waves with periods of years, proper motions of all that are longer; a power law of the energy connects the two.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from fit.background import add_pulsars, wave_limit
from fit.pairs import correlation_function
from vsh import Field
from vsh.figures.plot import figure_of
from vsh.models.waves import hellings_downs, timing_deflection

# %%
# How an isotropic background correlates what is seen at two places, in units of the mean square of a deflection: two pulsars
# (the curve of Hellings and Downs), a pulsar and a quasar (whose deflection is along the great circle through both), two quasars.
theta = np.linspace(0, np.pi, 200)
fig, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
ax.plot(np.degrees(theta), 2 * hellings_downs(theta), label="two pulsars")
ax.plot(np.degrees(theta), timing_deflection(theta), "--", label="a pulsar and a quasar")
lon, lat = sim.population.uniform_sky(20_000, 3)
waves = Field(lon, lat, sim.wave_background(1.0, rng=4)(lon, lat), np.full((2, 20_000), 1.0))
pairs = correlation_function(waves, np.radians(np.arange(0, 181, 6.0)))
curve = pairs.plus / np.mean(np.sum(waves.motion**2, 0))
ax.plot(np.degrees(pairs.theta), curve, ":", label="two quasars, one sky")
ax.axhline(0, color="0.7", lw=0.8, zorder=0)
ax.set_xlabel("angle [deg]")
ax.set_ylabel("correlation")
ax.legend()
figure_of(ax).savefig("overlap_functions.png")

# %%
# Waves that neither could miss, far more than there are: thirty pulsars, and the motions of a few quasars over three years.
omega, rng = 0.4, np.random.default_rng(1)
lon, lat = sim.population.uniform_sky(1500, rng)
motion = sim.wave_background(omega, rng=rng)(lon, lat) + 30 * rng.standard_normal((2, 1500))
limit = wave_limit(fit.normal_equations(Field(lon, lat, motion, np.full((2, 1500), 30.0)), 2), noise_scale=False)

# %%
# The table of cross-powers has a row for each pair, in units of the squared strain at 1 per 15 years: with Ω ∝ f^(2/3) the band of the
# motions has 4.4 times the energy of that frequency.
hubble_time_squared = (1 / 15 / 7.159e-11) ** 2
strain2 = 1.5 / np.pi**2 * omega / 4.386 / hubble_time_squared
table = sim.pulsar_pairs(30, strain2, strain2, rng)
both = add_pulsars(limit, table, years=3.0, bins=10, frequency=1 / 15)
print(both.report())

# %%
# Pulsars see a sum over as many waves as there are directions, motions the one quadrupole of our sky.
fig, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
grid = np.linspace(0, 2, 400)
for label, style, each in (("motions", "--", limit), ("motions and pulsars", "-", both)):
    density = each.likelihood(grid)
    ax.plot(grid, density / np.sum(density) / (grid[1] - grid[0]), style, label=label)
ax.axvline(omega, color="0.6", lw=1, label="truth")
ax.set_xlabel(r"$h_{70}^2\,\Omega$ of waves with f < 1/T")
ax.set_ylabel("posterior density, flat in Ω")
ax.legend()
figure_of(ax).savefig("pulsars_and_motions.png")
