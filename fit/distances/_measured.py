"""Inverse distances of sources whose distance or parallax was measured: no redshift is needed.

The true distance has the density p(d | data) ∝ d² exp(−d/L) N(data; …), that of sources in an exponentially thinning
space (Bailer-Jones 2015, PASP 127, 994), with L as the catalogue has it. A motion that falls as 1/d is expected to be
as E[1/d] has it: with parallaxes of small S/N, putting 1/ϖ in would bias it.
"""

from typing import NamedTuple

import numpy as np

from vsh.field import Field
from vsh.tools.errors import FieldError
from vsh.tools.parallel import map_blocks
from vsh.tools.types import BoolArray, FloatArray
from vsh.tools.units import AU_PER_YEAR

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)
_REACH, _BLOCK = 6.0, 4096
#: Below this S/N a parallax is integrated over in ln d, above it in ϖ.
_SURE = 6.0
#: So many sources tell the scale length to a per cent or two.
_SOURCES = 4000


class MeasuredRates(NamedTuple):
    """The motion that 1 km/s gives to each source, its mean and variance, and the scale length they were taken for.

    Attributes
    ----------
    mean : (n,) array
        [µas/yr per km/s]
    variance : (n,) array
    length : float
        L. [Mpc]
    n_parallaxes : int
        Sources whose parallax was used.
    """

    mean: FloatArray
    variance: FloatArray
    length: float
    n_parallaxes: int


def measured_rates(field: Field, length: float | None = None) -> MeasuredRates:
    """Mean and variance of the inverse distances of a field with distances, or parallaxes.

    Parameters
    ----------
    field : Field
        With a distance or a parallax for every source, and their errors; where both are known, the distance counts.
    length : float, optional
        Scale length L of the density of sources; that of greatest likelihood unless given. [Mpc]

    Raises
    ------
    FieldError
        If some source has neither; the message counts them.
    """
    by_distance = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    known = np.zeros(len(field), bool)
    if field.parallax is not None and field.parallax_error is not None:
        known = np.isfinite(field.parallax) & np.isfinite(field.parallax_error)
    lost = ~(by_distance | known)
    if lost.any():
        raise FieldError(
            f"{lost.sum()} of {len(field)} sources have neither a distance nor a parallax with its error (first: row "
            f"{lost.argmax()}): name the columns (distance= and distance_error=, or parallax= and parallax_error=; "
            "--columns), and leave those sources out (--where 'not ismissing(distance)')"
        )
    data, error = np.empty(len(field)), np.empty(len(field))
    if by_distance.any():
        assert field.distance is not None
        assert field.distance_error is not None
        data[by_distance], error[by_distance] = field.distance[by_distance], field.distance_error[by_distance]
    of_parallax = ~by_distance
    if of_parallax.any():
        assert field.parallax is not None
        assert field.parallax_error is not None
        data[of_parallax] = 1000 * field.parallax[of_parallax]  # 1 mas is 1000 per Mpc
        error[of_parallax] = 1000 * field.parallax_error[of_parallax]
    length = _length(data, error, of_parallax) if length is None else float(length)

    def block(part):
        return _moments(data[part], error[part], of_parallax[part], length)[:2]

    mean, variance = np.concatenate(list(map_blocks(block, len(field), _BLOCK)), axis=1)
    return MeasuredRates(mean, variance, length, int(of_parallax.sum()))


def _moments(data, error, of_parallax, length):
    """Mean and variance of the rate, and the logarithm of the density of the data, (3, n)."""
    sure = np.where(of_parallax, data > _SURE * error, True)
    step = _REACH * error
    low, high = data - step, data + step
    # Surely measured, the datum itself is integrated over; a parallax that is not, in ln d.
    floor = np.where(of_parallax, 1e-3 * np.abs(data), 1e-3 * data)
    low = np.where(sure, np.maximum(low, floor), np.log(1 / np.maximum(high, 1e-12)))
    high = np.where(sure, high, np.log(40 * length))
    high = np.maximum(high, low + 1.0 * ~sure)
    nodes = (high + low) / 2 + (high - low) / 2 * _NODES[:, None]
    with np.errstate(over="ignore"):
        distance = np.where(sure, np.where(of_parallax, 1 / nodes, nodes), np.exp(nodes))
        jacobian = np.where(sure, np.where(of_parallax, 2 * np.log(distance), 0.0), nodes)  # ln |dd/dnode|
        seen = np.where(of_parallax, 1 / distance, distance)
    log = 2 * np.log(distance) - distance / length - ((seen - data) / error) ** 2 / 2 + jacobian
    most = log.max(0)
    weight = np.exp(log - most) * _WEIGHTS[:, None]
    total = weight.sum(0)
    rate = 1 / (distance * AU_PER_YEAR)
    mean = (weight * rate).sum(0) / total
    variance = (weight * (rate - mean) ** 2).sum(0) / total
    # d² exp(−d/L)/(2 L³) is the density; the rest does not depend on L.
    return np.stack([mean, variance, np.log(total * (high - low) / 2) + most - 3 * np.log(length)])


def _length(data, error, of_parallax):
    """The scale length of greatest likelihood, by golden sections in its logarithm."""
    step = max(1, len(data) // _SOURCES)
    data, error, of_parallax = data[::step], error[::step], of_parallax[::step]
    typical = np.where(of_parallax, 1 / np.maximum(data, error), data)

    def minus(log_length):
        return -_moments(data, error, of_parallax, np.exp(log_length))[2].sum()

    grid = np.log(np.median(typical) / 3) + np.linspace(-4, 4, 33)
    best = int(np.argmin([minus(each) for each in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 32)]
    golden = (np.sqrt(5) - 1) / 2
    while high - low > 1e-3:
        a, b = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, b) if minus(a) < minus(b) else (a, high)
    return float(np.exp((low + high) / 2))


def has_distances(field: Field) -> BoolArray:
    """Which sources have a distance, or a parallax with its error, (n,)."""
    known = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    if field.parallax is None or field.parallax_error is None:
        return known
    return known | (np.isfinite(field.parallax) & np.isfinite(field.parallax_error))
