"""The inverse distance of each source: its mean and variance, given the redshift as observed and the magnitude.

The density of the true redshift z, x = ln(1 + z), is

    p(x | z_obs, G) ∝ n(d) d² d'(x) φ(G − 5 lg(d(1 + z)) − 25) N(ln(1 + z_obs) − x; 0, s²),

with s the error of ln(1 + z) by the source's own velocity and by measurement. What selected the sources by z_obs or by
G drops out. A motion that falls as 1/d is expected to be as E[1/d] has it (regression calibration; Carroll et al.
2006, Measurement Error in Nonlinear Models, ch. 4): putting the observed redshift in would bias it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.distances._calibration import Calibration
from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray
from vsh.cosmology import FLOW_LIMIT, to_cmb, transverse_distance, usable
from vsh.field import Field
from vsh.system.parallel import map_blocks
from vsh.units import AU_PER_YEAR

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_REACH = 6.0
_BLOCK = 8192


@dataclass(frozen=True, eq=False)
class InverseDistances(InNotebook):
    """What is known of 1/d of each source, as the motion that 1 km/s gives.

    Attributes
    ----------
    mean, variance : (n,) arrays
        Of 1/(4.740470 d). [µas/yr per km/s, and its square]
    slope : (n,) array
        By how much the mean changes with ln(1 + z_obs).
    own : (n,) mask
        Those whose distance is not from the redshift, and in Mpc whatever H0 is.
    redshift : (n,) array
        At rest in the microwave background.
    """

    mean: FloatArray
    variance: FloatArray
    slope: FloatArray
    own: FloatArray
    redshift: FloatArray

    @property
    def distance(self) -> FloatArray:
        """1/E[1/d], (n,). [Mpc]"""
        return 1 / (AU_PER_YEAR * self.mean)


def inverse_distances(field: Field, calibration: Calibration, threads: int | None = None) -> InverseDistances:
    """Mean and variance of the inverse distance of each source.

    Parameters
    ----------
    field : Field
        With redshifts, none missing or below 1e-4, and perhaps distances.
    calibration : Calibration
        Of its catalogue.
    threads : int, optional
        How many; one a core unless given.

    Raises
    ------
    FieldError
        If redshifts cannot be used.
    """
    redshift = calibration.redshift(field)
    mean = 1 / (AU_PER_YEAR * transverse_distance(redshift, calibration.cosmology))
    variance, slope = np.zeros(len(field)), np.zeros(len(field))
    spread = calibration.spread(field, redshift)
    unsure = np.flatnonzero(spread > 0)
    magnitude = None if calibration.luminosity is None else np.asarray(field.magnitude)

    def block(part):
        rows = unsure[part]
        x, s = np.log1p(redshift[rows]), spread[rows]
        return _by_redshift(calibration, x, s, None if magnitude is None else magnitude[rows])

    if unsure.size:
        found = list(map_blocks(block, unsure.size, _BLOCK, threads))
        mean[unsure], variance[unsure], slope[unsure] = np.concatenate(found, axis=1)
    if calibration.exact:
        slope[:] = 0.0
    own = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    if own.any():
        assert field.distance is not None
        assert field.distance_error is not None
        mean[own], variance[own] = _by_distance(
            calibration,
            field.distance[own],
            field.distance_error[own],
            redshift[own],
            None if magnitude is None else magnitude[own],
        )
        slope[own] = 0.0
    return InverseDistances(mean, variance, slope, own, redshift)


def mean_rates(field: Field, calibration: Calibration | None) -> FloatArray:
    """The motion that 1 km/s gives to each source, (n,), on average; nothing within the flow. [µas/yr per km/s]"""
    assert field.redshift is not None
    redshift = field.redshift
    if calibration is not None:
        redshift = to_cmb(redshift, field.lon, field.lat, field.frame, calibration.frame)
    far, rate = usable(redshift), np.zeros(len(field))
    if far.any():
        if calibration is None:
            rate[far] = 1 / (AU_PER_YEAR * transverse_distance(redshift[far]))
        else:
            rate[far] = inverse_distances(field[far], calibration).mean
    return rate


def _by_redshift(calibration, x, spread, magnitude):
    """Mean, variance and slope of the rate, (3, n)."""
    low, high = (
        np.maximum(x - _REACH * spread, np.log1p(FLOW_LIMIT)),
        np.maximum(x, np.log1p(FLOW_LIMIT)) + _REACH * spread,
    )
    half = (high - low) / 2
    nodes = (high + low) / 2 + half * _NODES[:, None]
    log_d, log_weight = calibration.log_distance(nodes)
    log_weight = log_weight - ((nodes - x) / spread) ** 2 / 2 + _log_prior(calibration, log_d, nodes, magnitude)
    weight = _normal(log_weight)
    rate = np.exp(-log_d) / AU_PER_YEAR
    mean = np.sum(weight * rate, 0)
    centre = np.sum(weight * nodes, 0)
    away = rate - mean
    return np.stack([mean, np.sum(weight * away**2, 0), np.sum(weight * away * (nodes - centre), 0) / spread**2])


def _by_distance(calibration, distance, error, redshift, magnitude):
    """Mean and variance of the rate where the distance itself was measured, (2, n)."""
    low, high = np.maximum(distance - _REACH * error, 1e-3 * distance), distance + _REACH * error
    nodes = (high + low) / 2 + (high - low) / 2 * _NODES[:, None]
    log_d = np.log(nodes)
    log_weight = 2 * log_d - ((nodes - distance) / error) ** 2 / 2
    weight = _normal(log_weight + _log_prior(calibration, log_d, np.log1p(redshift), magnitude))
    rate = np.exp(-log_d) / AU_PER_YEAR
    mean = np.sum(weight * rate, 0)
    return mean, np.sum(weight * (rate - mean) ** 2, 0)


def _log_prior(calibration, log_d, x, magnitude):
    """The density of sources at a distance, given their magnitudes."""
    log = calibration.density.log(np.exp(log_d))
    if magnitude is not None:
        log = log + calibration.luminosity.log(magnitude - 5 / np.log(10) * (log_d + x) - 25)
    return log


def _normal(log_weight):
    weight = _WEIGHTS[:, None] * np.exp(log_weight - log_weight.max(0))
    return weight / weight.sum(0)
