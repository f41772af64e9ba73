"""
A sky as Gaia sees it
=====================

Quasars on two skies, the five-year scanning law, variable photocentres, and what comes
back of a known acceleration.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from sim.variability import markov_chain
from vsh.figures.plot import COLOURS, STYLE, WIDTH, draw_line, panels, plot_map
from vsh.models.cosmology import transverse_distance
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import mean_map, pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools.units import AU_PER_YEAR

plt.rcParams.update(STYLE)
law = sim.NominalScanningLaw(dead_time=0.06, rng=1)
truth = sim.acceleration((-0.235965, -3.755779, -2.080491))
variability = sim.Variability(sigma=100.0, tau=2.0)


def plot_density(population, nside, title):
    """Sources per square degree, with the ecliptic."""
    pixels = pixels_of(population.lon, population.lat, nside)
    density = np.bincount(pixels, minlength=12 * nside**2) / (41252.96 / (12 * nside**2))
    axes = plot_map(
        density, "sources per square degree", frame=population.frame, title=title, vmin=0,
        vmax=np.percentile(density, 99), extend="max",
    )  # fmt: skip
    ecliptic = triad(np.linspace(0, 2 * np.pi, 721), np.zeros(721))[2]
    draw_line(axes, *angles(rotation_matrix("ecliptic", population.frame) @ ecliptic), color="cyan", label="ecliptic")
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0)
    return axes


# %%
# The same number of sources, all over the sky but for the Galactic plane (GUMS) or where the
# surveys before Gaia found them (IGQL): on this non-uniform sky spin and acceleration are correlated.
for sky in ("gums", "igql"):
    quasars = sim.quasars(20_000, rng=2, sky=sky)
    field = sim.observe(quasars, truth, rng=3, mission=law, release="paper", variability=variability)
    solution = fit.solve_frame(field.to_frame("galactic"))
    a = solution.acceleration
    print(f"{sky}: ã = {a.value.round(2)} ± {a.sigma.round(2)} µas/yr in Galactic axes; truth (4.3, 0, 0)")
    print(f"      largest correlation of spin and acceleration {np.abs(solution.correlation[:3, 3:]).max():.2f}")
    axes = plot_density(quasars, 8, f"{len(quasars)} quasars, {sky.upper()}-like")
    axes.figure.savefig(f"density_{sky}.png", dpi=300)

# %%
# The scanning law: how often each place is seen in five years.
everywhere = sim.Population(*sim.uniform_sky(20_000, rng=4))
transits = law.transits(everywhere.lon, everywhere.lat)
print(f"{len(transits) / len(everywhere):.1f} transits a source on average")
counts = mean_map(everywhere.lon, everywhere.lat, transits.counts(len(everywhere)), 16)
axes = plot_map(counts, "transits per source", frame="icrs", cmap="magma", title="transits by the scanning law")
axes.figure.savefig("transits.png", dpi=300)

# %%
# Variable photocentres at the times of one source's transits.
(axes,) = panels(None, size=(WIDTH, 3.2))
rng = np.random.default_rng(5)
for colour in COLOURS[:3]:
    times = transits.time[transits.source == 0]
    x, y = (markov_chain(times, variability.sigma, variability.tau, rng) for _ in range(2))
    axes.plot(x, y, ".-", linewidth=0.5, markersize=2, color=colour)
axes.set_aspect("equal", adjustable="datalim")
axes.invert_xaxis()  # east to the left
axes.set(xlabel="Δα* [µas]", ylabel="Δδ [µas]", title=f"σ = {variability.sigma:g} µas, τ = {variability.tau:g} yr")
axes.figure.savefig("tracks.png", dpi=300)

# %%
# The galaxies that Gaia sees as points: magnitudes and redshifts.
galaxies = sim.galaxies(20_000, rng=6)
subplots = panels(None, 1, 2, size=(WIDTH, 1.9))
for axes, name, values in zip(subplots, ("G  [mag]", "redshift"), (galaxies.magnitude, galaxies.redshift), strict=True):
    axes.hist(values, bins=60, color=COLOURS[0])
    axes.set(xlabel=name, ylabel="sources")
axes.figure.savefig("galaxies.png", dpi=300)

# %%
# Distance, and the secular parallax by our own velocity, 369 km/s.
z = np.geomspace(1e-3, 6, 400)
distance = transverse_distance(z)
subplots = panels(None, 1, 2, size=(WIDTH, 2.2))
for axes, values, label in zip(
    subplots, (distance, 369 / (AU_PER_YEAR * distance)), ("distance [Mpc]", "secular parallax [µas/yr]"), strict=True
):
    axes.loglog(z, values, color=COLOURS[0])
    axes.set(xlabel="redshift", ylabel=label)
plt.savefig("simulated_sky.png", dpi=300)
