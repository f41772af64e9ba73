"""Draws of positions, magnitudes and redshifts."""

from __future__ import annotations

import numpy as np

from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import FloatArray, Rng
from vsh.errors import ParameterError
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad

#: Quasars in Gaia's frame brighter than each magnitude (Gaia DR3, five-parameter solutions).
_BRIGHTER_THAN = {18.0: 29_200, 19.0: 175_814, 20.0: 665_975, 21.0: 1_215_942}
#: Sources with five and with six parameters.
CRF3_COUNTS = {31: 1_215_942, 95: 398_231}
#: By how much errors with six parameters are larger than those with five at one magnitude.
SIX_PARAMETERS = 1.25


@arguments.accepts(n=arguments.whole, rng=arguments.seed)
def uniform_sky(n: int, rng: Rng) -> tuple[FloatArray, FloatArray]:
    """n positions, uniform over the sphere: longitude and latitude. [rad]

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.

    Returns
    -------
    tuple[array, array]

    Examples
    --------
    >>> lon, lat = uniform_sky(1000, rng=1)
    >>> lon.shape, bool(abs(np.sin(lat).mean()) < 0.1)
    ((1000,), True)
    """
    rng = generator(rng)
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))


def plane_avoiding_sky(n: int, rng: Rng, latitude: float = 15.0) -> tuple[FloatArray, FloatArray]:
    """n positions in ICRS, uniform over the sphere but for the Galactic plane, |b| < `latitude` degrees. [rad]

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    latitude : float
        Below which there are none. [deg]

    Returns
    -------
    tuple[array, array]
    """
    rng = generator(rng)
    l = rng.uniform(0, 2 * np.pi, n)
    b = np.arcsin(rng.uniform(np.sin(np.radians(latitude)), 1, n)) * rng.choice([-1, 1], n)
    return angles(rotation_matrix("galactic", "icrs") @ triad(l, b)[2])


def quasar_magnitudes(n: int, rng: Rng, max_magnitude: float = 20.0) -> FloatArray:
    """n magnitudes G with the number counts of Gaia's quasars, log-linear between the published ones.

    Brighter than G = 18 the first slope is continued.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    max_magnitude : float
        The faintest G, at most 21.

    Raises
    ------
    ParameterError
        If the faintest magnitude is not above 18 and at most 21.
    """
    if not 18 < max_magnitude <= 21:
        raise ParameterError(f"the counts are known for 18 < G ≤ 21, not to {max_magnitude}")
    magnitude, log_count = np.array(list(_BRIGHTER_THAN)), np.log10(list(_BRIGHTER_THAN.values()))
    slope = log_count[1] - log_count[0]
    magnitude, log_count = np.insert(magnitude, 0, 12.0), np.insert(log_count, 0, log_count[0] - 6 * slope)
    top = np.interp(max_magnitude, magnitude, log_count)
    drawn = top + np.log10(1 - generator(rng).uniform(0, 1, n))
    return np.interp(drawn, log_count, magnitude)


def crf3_magnitudes(n_five: int, n_six: int, rng: Rng) -> FloatArray:
    """Magnitudes G like those of Gaia-CRF3: of sources with five parameters, then of those with six.

    Parameters
    ----------
    n_five, n_six : int
        How many of each.
    rng : Generator or int
        The source of all randomness.
    """
    rng = generator(rng)
    return np.concatenate([quasar_magnitudes(n_five, rng, 21.0), 21 - rng.gamma(2.0, 0.32, n_six)])


def quasar_redshifts(n: int, rng: Rng, scale: float = 0.55, shape: float = 2.7) -> FloatArray:
    """n redshifts from a gamma distribution of mean 1.5, about that of Gaia's and SDSS' quasars; at least 0.05.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    scale : float
        Of the gamma distribution.
    shape : float
        Of the gamma distribution.
    """
    return np.maximum(generator(rng).gamma(shape, scale, n), 0.05)
