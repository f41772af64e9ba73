"""
Gravitational waves in pulsars and in motions
=============================================

A gravitational wave shifts the frequency of pulsars and deflects the light of quasars by the same strain at the Earth. Pulsars tell
of waves with periods of years, proper motions of all that are longer; a power law of the energy connects the two.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import logsumexp

import fit
import sim
from fit.background import wave_limit
from fit.pairs import correlation_function
from vsh import Field
from vsh.figures.plot import STYLE, figure_of
from vsh.sky.sphere import triad

plt.rcParams.update(STYLE)

# %%
# How an isotropic background correlates what is seen at two places, in units of the mean square of a deflection: two pulsars
# (Hellings & Downs 1983, ApJ 265, L39), a pulsar and a quasar, whose deflection is along the great circle through both (sin θ + 3 x
# tan(θ/2) ln x, x = sin²(θ/2)), two quasars.


def hellings_downs(theta):
    """Correlation of the redshifts of two pulsars, ½ at zero angle."""
    x = np.sin(theta / 2) ** 2
    return 0.5 + 1.5 * x * np.log(np.where(x > 0, x, 1.0)) - 0.25 * x


theta = np.linspace(0, np.pi, 200)[:-1]
x = np.sin(theta / 2) ** 2
plt.rcParams.update(STYLE)
fig, ax = plt.subplots()
ax.plot(np.degrees(theta), 2 * hellings_downs(theta), label="two pulsars")
timing_deflection = np.sin(theta) + 3 * x * np.tan(theta / 2) * np.log(np.where(x > 0, x, 1.0))
ax.plot(np.degrees(theta), timing_deflection, "--", label="a pulsar and a quasar")
lon, lat = sim.population.uniform_sky(20_000, 3)
waves = Field(lon, lat, sim.wave_background(1.0, rng=4)(lon, lat), np.full((2, 20_000), 1.0))
pairs = correlation_function(waves, np.radians(np.arange(0, 181, 6.0)))
curve = pairs.plus / np.mean(np.sum(waves.motion**2, 0))
ax.plot(np.degrees(pairs.theta), curve, ":", label="two quasars, one sky")
ax.axhline(0, color="0.7", lw=0.8, zorder=0)
ax.set(xlim=(0, 180), xticks=range(0, 181, 30), xlabel="angle between the two  [°]")
ax.set_ylabel("correlation")
ax.legend()
figure_of(ax).savefig("overlap_functions.png")

# %%
# Waves that neither could miss, far more than there are: thirty pulsars, and the motions of a few quasars over three years.
omega, rng, n, bins = 0.4, np.random.default_rng(1), 30, 10
lon, lat = sim.population.uniform_sky(1500, rng)
motion = sim.wave_background(omega, rng=rng)(lon, lat) + 30 * rng.standard_normal((2, 1500))
limit = wave_limit(fit.normal_equations(Field(lon, lat, motion, np.full((2, 1500), 30.0)), 2), noise_scale=False)

# %%
# Cross-powers of the pulsars at 1 per 15 years, in units of the squared strain there. With Ω ∝ f^(2/3) the band of the motions, f < 1/T,
# has 4.4 times the energy of that frequency, and Ω(f) = 2π² f² h²/(3 H0²). Each pulsar has waves of its own besides, as strong as those
# at the Earth, and noise.
in_band = 1.5 * (1 / (3.0 / 15)) ** (2 / 3)
strain2_of_omega = 1.5 / np.pi**2 / in_band / (1 / 15 / 7.159e-11) ** 2
strain2 = noise = strain2_of_omega * omega
r = triad(*sim.population.uniform_sky(n, rng))[2]
shape = hellings_downs(np.arccos(np.clip(r.T @ r, -1, 1)))
np.fill_diagonal(shape, 1.0)
root = np.linalg.cholesky(strain2 * shape + noise * np.eye(n))
z = root @ (rng.standard_normal((n, bins)) + 1j * rng.standard_normal((n, bins))) / np.sqrt(2)
cross_powers = (z @ z.conj().T).real / bins

# %%
# Their likelihood is Wishart's, −k (ln det C + tr C⁻¹ S) with C = Γ h² + noise, exact for waves of any strength. A factor on the noise of
# all is marginalised, because a noise that is too small would pass for waves.
grid = np.linspace(0, 2, 400)
values, vectors = np.linalg.eigh(shape)
shares = np.sum(vectors * (cross_powers @ vectors), axis=0)
factors = np.geomspace(0.5, 2.0, 57)
spread = noise * factors[:, None, None] + np.multiply.outer(strain2_of_omega * grid, values)
log_likelihood = logsumexp(-bins * np.sum(np.log(spread) + shares / spread, axis=2), axis=0)
densities = {"motions": limit.likelihood(grid), "pulsars": np.exp(log_likelihood - log_likelihood.max())}
densities["motions and pulsars"] = densities["motions"] * densities["pulsars"]

# %%
# Pulsars see a sum over as many waves as there are directions, motions the one quadrupole of our sky: their likelihood falls slowly
# beyond its maximum, so that together they move the pulsars' towards the truth and make it no narrower.
fig, ax = plt.subplots()
for (label, density), style in zip(densities.items(), ("--", ":", "-"), strict=True):
    density = density / np.sum(density)
    low, high = np.interp([0.16, 0.84], np.cumsum(density), grid)
    print(f"{label}: Ω from {low:.2f} to {high:.2f} (68 %), {omega} is true")
    ax.plot(grid, density / (grid[1] - grid[0]), style, label=label)
ax.axvline(omega, color="0.6", lw=1, label="truth")
ax.set_xlim(0, 1.2)
ax.set_xlabel(r"$h_{70}^2\,\Omega$ of waves with f < 1/T")
ax.set_ylabel("posterior density, flat in Ω")
ax.legend()
figure_of(ax).savefig("pulsars_and_motions.png")
