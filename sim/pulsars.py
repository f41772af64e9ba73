"""Cross-powers of pairs of pulsars in a background of gravitational waves, as arrays of pulsars publish them."""

import numpy as np

from sim.population import uniform_sky
from vsh.io import tables
from vsh.models.waves import hellings_downs
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray, Rng, Table

__all__ = ["pulsar_pairs", "timing_noise"]


def timing_noise(error: float, interval: float, frequency: float) -> float:
    """White noise of the residuals of a pulsar as a squared characteristic strain, 12 π² f³ × 2 σ² Δt.

    Parameters
    ----------
    error : float
        σ of a residual. [ns]
    interval : float
        Δt between residuals. [day]
    frequency : float
        Frequency. [1/yr]
    """
    day, hertz = 86400.0, arguments.positive("frequency", frequency) / (365.25 * 86400)
    variance = (1e-9 * arguments.positive("error", error)) ** 2
    return 12 * np.pi**2 * hertz**3 * 2 * variance * arguments.positive("interval", interval) * day


def pulsar_pairs(n: int, power: float, noise: float, rng: Rng, *, bins: int = 10) -> Table:
    """Simulate the cross-powers of all pairs of some pulsars.

    Parameters
    ----------
    n : int
        Number of pulsars, anywhere on the sky.
    power : float
        Squared characteristic strain h_c² of the waves.
    noise : float
        Noise of each pulsar in the same unit (`timing_noise`).
    rng : Generator or int
        The source of all randomness.
    bins : int
        Bins of frequency over which the cross-powers are means, all with the same power and noise.

    Returns
    -------
    astropy Table
        A row for each pair, also of a pulsar with itself: first and second, the names of the pulsars, angle [deg], and
        the real part of their cross-power, on average Γ h_c² for two and h_c² and the noise for one, and that noise.

    Raises
    ------
    ParameterError
        If there are fewer than two pulsars, or a power is below zero.

    Examples
    --------
    >>> table = pulsar_pairs(20, 1e-30, 1e-30, 1)
    >>> len(table)
    210
    """
    if arguments.whole("n", n) < 2:
        raise ParameterError("a pair takes two pulsars")
    power, noise = arguments.not_negative("power", power), arguments.positive("noise", noise)
    rng = arguments.generator(rng)
    r = triad(*uniform_sky(n, rng))[2]
    angle = np.arccos(np.clip(r.T @ r, -1, 1))
    np.fill_diagonal(angle, 0.0)
    # Each pulsar has waves of its own besides, as strong as those at the Earth.
    covariance = power * hellings_downs(angle)
    covariance[np.diag_indices(n)] = power + noise
    root = np.linalg.cholesky(covariance)
    z = root @ (rng.standard_normal((n, bins)) + 1j * rng.standard_normal((n, bins))) / np.sqrt(2)
    products: FloatArray = (z @ z.conj().T).real / arguments.whole("bins", bins)
    first, second = np.triu_indices(n)
    names = np.array([f"PSR{k + 1:04d}" for k in range(n)])
    columns = {"first": names[first], "second": names[second], "angle": np.degrees(angle[first, second])}
    columns |= {"power": products[first, second], "noise": np.where(first == second, noise, np.nan)}
    return tables.table_of(columns, {"POWER": power, "NOISE": noise}, {"angle": "deg"})
