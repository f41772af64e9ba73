"""
H0 with realistic errors
========================

The Solar System moves at 370 km/s relative to the microwave background. Nearby galaxies therefore show an apparent
motion in the opposite direction, by our velocity divided by their distance. Since distances are obtained from
redshifts by means of the Hubble constant, this motion determines the product of velocity and H0; if our velocity is
known, it gives H0 without a distance ladder. This tutorial measures it on a simulated sky of Gaia DR5, first with
simple assumptions, and then with the three effects that make the simple error wrong: the frame of the redshifts,
coherent flows, and the prior.
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
# Simple assumptions
# ------------------
#
# Least squares; each galaxy has an independent peculiar velocity of 150 km/s, and redshifts are used as they are.
naive = hubble_constant(field, CMB_VELOCITY_PLANCK18, redshift_frame="true", flows=None, peculiar_dispersion=150.0)
print(f"H0 = {naive.hubble:.1f} ± {naive.hubble_error:.1f} km/s/Mpc; truth {TRUE_H0:g}")

# %%
# The frame of the redshifts
# --------------------------
#
# An observed redshift includes our own motion: galaxies towards which we move are blueshifted, appear to be closer
# than they are, and their motions are interpreted as too small a velocity. If the table states the frame of its
# redshifts, nothing needs to be done; this one does.
print("this field's redshifts are", field.redshift_frame)
framed = hubble_constant(field, CMB_VELOCITY_PLANCK18, flows=None, peculiar_dispersion=150.0)
print(f"H0 = {framed.hubble:.1f} ± {framed.hubble_error:.1f} km/s/Mpc")

# %%
# Flows
# -----
#
# Peculiar velocities of galaxies are correlated: galaxies stream together towards concentrations of mass, and a
# thousand galaxies of one stream are one measurement. Unless ``flows=None`` is given, as above, the velocity field is
# fitted as a sum of modes with the variances of linear theory. The error becomes larger because the smaller one was
# wrong.
honest = hubble_constant(field, CMB_VELOCITY_PLANCK18)
print(honest.report())
print(f"with flows as unknowns the error is {honest.hubble_error / framed.hubble_error:.1f} times as large")

# %%
# The fitted flow is a result as well.
honest.flow.plot()

# %%
# The prior
# ---------
#
# If the error is half of the value, the posterior is skewed and depends on the prior of H0. Sample it with several
# priors: if the result follows the prior, the data do not determine H0.
for words, prior in (("flat between 20 and 150", Flat(20, 150)), ("70 ± 10", Normal(70, 10))):
    found = sample(field, CMB_VELOCITY_PLANCK18, prior, n_samples=200_000, rng=4, progress=False)
    low, middle, high = np.percentile(found.samples["H0"], [16, 50, 84])
    print(f"prior {words}: H0 = {middle:.1f} (+{high - middle:.1f} −{middle - low:.1f}) km/s/Mpc")

# %%
# All pairs of quantities, with the truth:
found.corner(["H0", "speed", "a_x", "a_y", "a_z"], truths={"H0": TRUE_H0, "speed": CMB_VELOCITY_PLANCK18.amplitude})

# %%
# ``found.to_arviz()`` converts the chain for ArviZ; vectors have their axes as coordinates.
#
# From the command line::
#
#     vsh-redshift galaxies.fits --velocity planck --posterior --h0 20:150 --output hubble
#
# One sky is one realisation of the flow: with other seeds the simple fit is wrong by as much in either direction.
# More on the frames of redshifts, distances and flows: :doc:`../redshifts`.
