"""
What a non-uniform sky correlates
=================================

Two skies, seen with the same errors: quasars all over the sky but for the Galactic plane, and a
list pieced together from surveys, thin in the south. On the second, spin and acceleration cannot
be separated well. Which parameters, which part of the sky causes it, what would help?
"""

import matplotlib.pyplot as plt
import numpy as np

import sim
from fit.correlation import correlation_matrices, influence_map, leakage, plot_influence, predict_covariance
from sim.expected import errors_by_place
from vsh import Field

# %%
# Positions and errors are enough: no motion has been measured yet.
law = sim.NominalScanningLaw(dead_time=0.06, rng=1)


def catalogue(sky):
    quasars = sim.quasars(50_000, rng=2, sky=sky)
    sigma, rho = errors_by_place(quasars.magnitude, quasars.lon, quasars.lat, law, release="paper")
    return Field(quasars.lon, quasars.lat, np.zeros_like(sigma), sigma, rho).to_frame("galactic")


gums, igql = catalogue("gums"), catalogue("igql")

# %%
# The correlation matrices, one in each triangle, as in Bachchan et al. (2016), and what the
# dipole of each catalogue explains of them.
both = correlation_matrices({"GUMS-like": gums, "IGQL-like": igql})
print(both.report())
both.plot()
plt.savefig("correlation_matrices.png", dpi=300)

# %%
# Where it comes from: the change of one correlation if the weight of a pixel were doubled.
blame = influence_map(igql, "spin+acceleration", ("omega_x", "a_y"), nside=16)
plot_influence(
    blame, igql, "IGQL-like: what ties $\\omega_x$ to $\\tilde a_y$", "its change where the sources (dots) weigh twice"
)
plt.savefig("influence.png", dpi=300)

# %%
# What a cut would do: of half of the dense northern cap, say.
thin = (igql.lat < np.radians(28)) | (np.random.default_rng(3).uniform(size=len(igql)) < 0.5)
for name, field in (("all", igql), ("half of the northern cap", igql[thin])):
    prediction = predict_covariance(field, 1)
    errors, (value, pair) = ", ".join(f"{each:.2f}" for each in prediction.acceleration.sigma), prediction.largest
    print(
        f"{name}: errors of the acceleration {errors} µas/yr, largest correlation {value:+.2f}, of {' and '.join(pair)}"
    )

# %%
# What is not fitted leaks into what is: one (µas/yr)² in each degree from 2 to 4.
for name, field in (("GUMS-like", gums), ("IGQL-like", igql)):
    bias = leakage(field, fitted=1, unmodelled=4).bias_of(("a_x", "a_y", "a_z"), power=1.0)
    print(
        f"{name}: rms bias of the acceleration "
        + ", ".join(f"{name} {value:.2f}" for name, value in bias.items())
        + " µas/yr"
    )
