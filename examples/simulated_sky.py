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
from sim.plot import plot_density, plot_distance_and_parallax, plot_histograms, plot_tracks, plot_transits
from vsh.figures.plot import figure_of

law = sim.NominalScanningLaw(dead_time=0.06, rng=1)
truth = sim.acceleration((-0.235965, -3.755779, -2.080491))
variability = sim.Variability(sigma=100.0, tau=2.0)

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
    plot_density(quasars, nside=8, title=f"{len(quasars)} quasars, {sky.upper()}-like").figure.savefig(
        f"density_{sky}.png", dpi=300
    )

# %%
# The scanning law, and the rest of the picture.
everywhere = sim.Population(*sim.uniform_sky(20_000, rng=4))
transits = law.transits(everywhere.lon, everywhere.lat)
print(f"{len(transits) / len(everywhere):.1f} transits a source on average")
plot_transits(everywhere, transits.counts(len(everywhere))).figure.savefig("transits.png", dpi=300)
one = transits.time[transits.source == 0]
plot_tracks(one, variability, rng=5).figure.savefig("tracks.png", dpi=300)
figure_of(plot_histograms(sim.galaxies(20_000, rng=6))).savefig("galaxies.png", dpi=300)
plot_distance_and_parallax()
plt.savefig("simulated_sky.png", dpi=300)
