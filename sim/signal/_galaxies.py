"""Motions of galaxies by our own, which fall with distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.signal._peculiar import distance_of
from sim.signal._signal import Observer, Signal, direction_of
from vsh.checks.arguments import positive
from vsh.checks.types import ArrayLike, Cosmology, FloatArray
from vsh.cosmology import parallax_factor
from vsh.sky.sphere import triad
from vsh.units import AU_PER_YEAR


@dataclass(frozen=True)
class SecularParallax(Observer):
    """Parallax by our velocity [km/s, toward the apex]."""

    velocity: FloatArray
    cosmology: object
    hubble: float | None

    def __call__(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        p, q, _ = triad(lon, lat)
        distance = distance_of(redshift, self.cosmology, self.hubble)
        # The curvature acts on distances for the cosmology's own H0.
        factor = parallax_factor(distance_of(redshift, self.cosmology, None), self.cosmology)
        return -np.stack([self.velocity @ p, self.velocity @ q]) * (factor / (AU_PER_YEAR * distance))


def secular_parallax(velocity: ArrayLike, *, cosmology: Cosmology | None = None, hubble: float | None = None) -> Signal:
    """Parallax by our own motion through the Universe: µ = −v_⊥/d_P, towards the antapex; d_P is d_M where space is flat.

    Parameters
    ----------
    velocity : (3,) array
        Ours with respect to the background, towards the apex, along the
        axes of the frame [km/s]
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.
    hubble : float, optional
        H0 in place of the cosmology's [km/s/Mpc]

    Notes
    -----
    Bachchan, Hobbs & Lindegren (2016), sect. 2.3.
    """
    hubble = None if hubble is None else positive("hubble", hubble)
    return Signal((SecularParallax(direction_of(velocity, "velocity", "km / s"), cosmology, hubble),))
