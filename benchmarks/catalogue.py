"""The synthetic catalogue that every benchmark times."""

import numpy as np

import sim
from vsh import Coefficients, Field


def synthetic(n, seed=1, latitude=11.54):
    """n sources with full correlations on 80 % of the sky (|b| > 11.54°)."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.plane_avoiding_sky(n, rng, latitude)
    sigma, rho = rng.uniform(50, 500, (2, n)), rng.uniform(-0.9, 0.9, n)
    truth = Coefficients.from_vectors(rotation=(1, -2, 3), glide=(-0.3, -4.4, -2.4))
    return Field(lon, lat, truth.at(lon, lat) + sigma * rng.standard_normal((2, n)), sigma, rho)
