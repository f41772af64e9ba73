"""Sources: where they are, how bright, how far."""

from dataclasses import dataclass

import numpy as np

from vsh.frames import check_frame, rotation_matrix
from vsh.sphere import angles, triad

#: Quasars in Gaia's frame brighter than each magnitude (Gaia DR3, five-parameter solutions).
_BRIGHTER_THAN = {18.0: 29_200, 19.0: 175_814, 20.0: 665_975, 21.0: 1_215_942}


@dataclass(frozen=True, eq=False)
class Population:
    """Sources as they are, before anybody observes them.

    Attributes
    ----------
    lon, lat : (n,) arrays — positions [rad]
    magnitude : (n,) array — G
    redshift : (n,) array or None
    frame : str — of the positions
    """

    lon: np.ndarray
    lat: np.ndarray
    magnitude: np.ndarray
    redshift: np.ndarray = None
    frame: str = "icrs"

    def __post_init__(self):
        check_frame(self.frame)

    def __len__(self):
        return len(self.lon)


def uniform_sky(n, rng):
    """n positions, uniform over the sphere: longitude and latitude. [rad]

    >>> lon, lat = uniform_sky(1000, rng=1)
    >>> lon.shape, bool(abs(np.sin(lat).mean()) < 0.1)
    ((1000,), True)
    """
    rng = np.random.default_rng(rng)
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))


def plane_avoiding_sky(n, rng, latitude=15.0):
    """n positions in ICRS, uniform over the sphere but for the Galactic plane, |b| < `latitude` degrees. [rad]"""
    rng = np.random.default_rng(rng)
    l = rng.uniform(0, 2 * np.pi, n)
    b = np.arcsin(rng.uniform(np.sin(np.radians(latitude)), 1, n)) * rng.choice([-1, 1], n)
    return tuple(angles(rotation_matrix("galactic", "icrs") @ triad(l, b)[2]))


def quasars(n, rng, sky="uniform", faintest=20.0):
    """n quasars with Gaia's distribution of magnitudes.

    Parameters
    ----------
    n : int
    rng : Generator or int — the source of all randomness
    sky : {"uniform", "plane-avoiding"}
    faintest : float — the faintest G, at most 21

    Returns
    -------
    Population
        In ICRS.
    """
    skies = {"uniform": uniform_sky, "plane-avoiding": plane_avoiding_sky}
    if sky not in skies:
        raise ValueError(f"unknown sky {sky!r}: choose one of {', '.join(skies)}")
    rng = np.random.default_rng(rng)
    lon, lat = skies[sky](n, rng)
    return Population(lon, lat, quasar_magnitudes(n, rng, faintest))


def quasar_magnitudes(n, rng, faintest=20.0):
    """n magnitudes G with the number counts of Gaia's quasars, log-linear between the published ones.

    Brighter than G = 18 the first slope is continued.
    """
    if not 18 < faintest <= 21:
        raise ValueError(f"the counts are known for 18 < G ≤ 21, not to {faintest}")
    magnitude, log_count = np.array(list(_BRIGHTER_THAN)), np.log10(list(_BRIGHTER_THAN.values()))
    slope = log_count[1] - log_count[0]
    magnitude, log_count = np.insert(magnitude, 0, 12.0), np.insert(log_count, 0, log_count[0] - 6 * slope)
    top = np.interp(faintest, magnitude, log_count)
    drawn = top + np.log10(1 - np.random.default_rng(rng).uniform(0, 1, n))
    return np.interp(drawn, log_count, magnitude)
