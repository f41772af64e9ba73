"""Motions of galaxies that fall with distance: secular parallax and peculiar velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.signal._signal import Signal, direction_of
from vsh.checks import arguments
from vsh.checks.arguments import generator, not_negative, positive, whole
from vsh.sky.sphere import triad
from vsh.types import ArrayLike, Cosmology, FloatArray, Rng
from vsh.units import AU_PER_YEAR


@dataclass(frozen=True)
class SecularParallax:
    """Parallax by our velocity [km/s, toward the apex]."""

    velocity: FloatArray
    cosmology: object
    hubble: float | None

    def __call__(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        p, q, _ = triad(lon, lat)
        distance = _distance(redshift, self.cosmology, self.hubble)
        return -np.stack([self.velocity @ p, self.velocity @ q]) / (AU_PER_YEAR * distance)


@dataclass(frozen=True)
class Peculiar:
    """Random velocities [km/s], the same sky from the same seed."""

    sigma: float
    seed: int
    length: float | None
    cosmology: object
    hubble: float | None
    n_waves: int

    def __call__(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        draw = np.random.default_rng(self.seed)
        distance = _distance(redshift, self.cosmology, self.hubble)
        p, q, r = triad(lon, lat)
        if self.length is None:
            return self.sigma * draw.standard_normal((2, len(lon))) / (AU_PER_YEAR * distance)
        numbers = draw.standard_normal((self.n_waves, 3)) / self.length
        phases = draw.uniform(0, 2 * np.pi, self.n_waves)
        amplitudes = draw.standard_normal((3, self.n_waves)) * self.sigma * np.sqrt(2 / self.n_waves)
        velocity = np.empty((3, len(lon)))
        for start in range(0, len(lon), 8192):
            block = slice(start, start + 8192)
            velocity[:, block] = amplitudes @ np.cos(numbers @ (r * distance)[:, block] + phases[:, None])
        return np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)]) / (AU_PER_YEAR * distance)


def secular_parallax(velocity: ArrayLike, *, cosmology: Cosmology | None = None, hubble: float | None = None) -> Signal:
    """Parallax by our own motion through the Universe: µ = −v_⊥/d_M, towards the antapex.

    Parameters
    ----------
    velocity : (3,) array
        Ours with respect to the background, towards the apex, along the
        axes of the frame [km/s]
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.
    hubble : float, optional
        H0 in place of the cosmology's [km/s/Mpc]

    Returns
    -------
    Signal

    Notes
    -----
    Bachchan, Hobbs & Lindegren (2016), sect. 2.3.
    """
    hubble = None if hubble is None else positive("hubble", hubble)
    return Signal((SecularParallax(direction_of(velocity, "velocity", "km / s"), cosmology, hubble),))


@arguments.accepts(rng=arguments.seed)
def peculiar(
    sigma: float,
    rng: Rng,
    *,
    length: float | None = None,
    cosmology: Cosmology | None = None,
    hubble: float | None = None,
    n_waves: int = 256,
) -> Signal:
    """Random velocities of the galaxies, in each component a Gaussian of standard deviation `sigma`.

    Parameters
    ----------
    sigma : float
        [km/s]
    rng : Generator or int
        Drawn from once, here: the same signal gives the same sky again.
    length : float, optional
        Velocities r apart are correlated by exp(−r²/(2 length²));
        independent unless given [Mpc]
    cosmology, hubble
        As for `secular_parallax`.
    n_waves : int
        Plane waves that make up a correlated field.

    Returns
    -------
    Signal
    """
    length = None if length is None else positive("length", length)
    hubble = None if hubble is None else positive("hubble", hubble)
    seed = int(generator(rng).integers(2**63))
    return Signal((Peculiar(not_negative("sigma", sigma), seed, length, cosmology, hubble, whole("n_waves", n_waves)),))


def hubble_rate(hubble: float) -> float:
    """H0 as an angular rate, as angles would change in an expansion on one axis only. [µas/yr]

    Parameters
    ----------
    hubble : float
        H0. [km/s/Mpc]

    Returns
    -------
    float

    Examples
    --------
    >>> round(hubble_rate(67.3), 4), round(hubble_rate(70), 4)
    (14.1969, 14.7665)
    """
    # d = 1 Mpc recedes at `hubble` km/s: the angle v / d.
    return hubble / AU_PER_YEAR


def _distance(redshift, cosmology, hubble):
    from vsh.cosmology import PLANCK_2013, transverse_distance  # astropy

    return transverse_distance(redshift, PLANCK_2013 if cosmology is None else cosmology, hubble=hubble)
