"""
H0, honestly
============

We move at 370 km/s against the microwave background. Nearby galaxies therefore drift backwards over the sky, by our velocity over their
distance; and since distances follow from redshifts by the Hubble constant, the drift tells the product of the two. With our velocity known, it
tells H0 without any ladder of distances. This page measures it on a simulated sky of Gaia's fifth release, first naively, and then with
the three things that make the naive error wrong: the frame of the redshifts, coherent flows, and the prior.
"""

import numpy as np

import sim
from fit.posterior import Flat, Normal, sample
from fit.secular_parallax import hubble_constant
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

TRUE_H0 = 70.0
galaxies = sim.galaxies(20_000, rng=1, min_redshift=0.003)
drift = sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value, hubble=TRUE_H0)
flow = sim.peculiar(150.0, rng=6, flow="linear", hubble=TRUE_H0)
glide = sim.acceleration((-0.277, -4.411, -2.443))
field = sim.observe(galaxies, drift + flow + glide, rng=3, sigma=2.0, redshifts="heliocentric")
field

# %%
# Naively
# -------
#
# Least squares, each galaxy with a velocity of its own of 150 km/s, redshifts as they stand.
naive = hubble_constant(field, CMB_VELOCITY_PLANCK18, redshift_frame="true", flows=None, peculiar_dispersion=150.0)
print(f"H0 = {naive.hubble:.1f} ± {naive.hubble_error:.1f} km/s/Mpc; truth {TRUE_H0:g}")

# %%
# The frame of the redshifts
# --------------------------
#
# A redshift that we measure holds our own motion: galaxies towards which we move are blueshifted, look nearer than they are, and seem to drift too
# little. A table that says where its redshifts stand needs no more; this one does.
print("this field's redshifts are", field.redshift_frame)
framed = hubble_constant(field, CMB_VELOCITY_PLANCK18, flows=None, peculiar_dispersion=150.0)
print(f"H0 = {framed.hubble:.1f} ± {framed.hubble_error:.1f} km/s/Mpc")

# %%
# Flows
# -----
#
# Galaxies do not move each for itself: they stream together towards where mass is. A thousand galaxies of one stream are one measurement. Unless it is told
# ``flows=None``, as above, the fit holds the velocity field as a sum of modes with the variances that linear theory gives them. The error grows: that
# is not a loss, it is what the error was.
honest = hubble_constant(field, CMB_VELOCITY_PLANCK18)
print(honest.report())
print(f"with flows as unknowns the error is {honest.hubble_error / framed.hubble_error:.1f} times as large")

# %%
# The flow that was found is a result of its own.
honest.flow.plot()

# %%
# The prior
# ---------
#
# An error of half the value is no ± any more: the posterior is skew, and what is assumed of H0 before shows in what is found. So sample it, under several
# priors. If the answer follows the prior, the data did not know.
for words, prior in (("flat between 20 and 150", Flat(20, 150)), ("70 ± 10", Normal(70, 10))):
    found = sample(field, CMB_VELOCITY_PLANCK18, prior, n_samples=200_000, rng=4, progress=False)
    low, middle, high = np.percentile(found.samples["H0"], [16, 50, 84])
    print(f"prior {words}: H0 = {middle:.1f} (+{high - middle:.1f} −{middle - low:.1f}) km/s/Mpc")

# %%
# Every pair of quantities, with the truth:
found.corner(["H0", "speed", "a_x", "a_y", "a_z"], truths={"H0": TRUE_H0, "speed": CMB_VELOCITY_PLANCK18.amplitude})

# %%
# The chain goes on to where others look at chains: ``found.to_arviz()`` has the vectors with their axes as coordinates.
#
# From a shell::
#
#     vsh-redshift galaxies.fits --velocity planck --posterior --h0-range 20,150 --output hubble
#
# One sky is one draw of the flow: with other seeds the naive fit is off by as much to either side. Which frame redshifts stand in, how distances follow from them, what flows do: :doc:`../redshifts`.
