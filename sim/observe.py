"""A true field, seen through noise."""

import numpy as np

from sim.noise import gaia_errors
from sim.signal import as_signal
from vsh import Field


def observe(population, signal, rng, sigma=None, rho=0.0, release="DR3"):
    """Draw a field whose expectation is the signal.

    Parameters
    ----------
    population : Population
        Where the sources are and how bright.
    signal : Signal or Coefficients
        The true motions, in the population's frame. [µas/yr]
    rng : Generator or int
        The source of all randomness; there is no other.
    sigma : float or array that broadcasts to (2, n), optional
        Standard errors; Gaia's by magnitude unless given. [µas/yr]
    rho : float or (n,) array
        Correlation of the two components.
    release : {"DR3", "DR4", "DR5"}
        Whose errors.

    Returns
    -------
    Field

    Examples
    --------
    >>> from sim import acceleration, quasars
    >>> len(observe(quasars(100, rng=1), acceleration((5, 0, 0)), rng=2))
    100
    """
    rng = np.random.default_rng(rng)
    n = len(population)
    if sigma is None:
        sigma = gaia_errors(population.magnitude, release)
    sigma, rho = np.broadcast_to(sigma, (2, n)), np.broadcast_to(rho, n)
    unit = rng.standard_normal((2, n))
    noise = sigma * np.stack([unit[0], rho * unit[0] + np.sqrt(1 - rho**2) * unit[1]])
    motion = as_signal(signal)(population.lon, population.lat, population.redshift) + noise
    return Field(
        population.lon,
        population.lat,
        motion,
        sigma,
        rho,
        redshift=population.redshift,
        magnitude=population.magnitude,
        frame=population.frame,
    )
