"""What turns redshifts of a catalogue into distances: frame, velocities, density, luminosities.

The inverse distance of each source: its mean and variance, given the redshift as observed and the magnitude.

The density of the true redshift z, x = ln(1 + z), is

    p(x | z_obs, G) ∝ n(d) d² d'(x) φ(G − 5 lg(d(1 + z)) − 25) N(ln(1 + z_obs) − x; 0, s²),

with s the error of ln(1 + z) by the source's own velocity and by measurement. What selected the sources by z_obs or by
G drops out. A motion that falls as 1/d is expected to be as E[1/d] has it (regression calibration; Carroll et al.
2006, Measurement Error in Nonlinear Models, ch. 4): putting the observed redshift in would bias it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline

from fit.distances._density import ErrorsByRedshift, LuminosityFunction, SourceDensity
from vsh.field import Field
from vsh.models.cosmology import FLOW_LIMIT, count_unusable, hubble_value, to_cmb, transverse_distance, usable
from vsh.sky.frames import TRUE
from vsh.tools.errors import FieldError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.types import BoolArray, Cosmology, FloatArray
from vsh.tools.units import AU_PER_YEAR, SPEED_OF_LIGHT


@dataclass(frozen=True, eq=False)
class Calibration(InNotebook):
    """How the distances of a catalogue follow from its redshifts.

    Attributes
    ----------
    frame : str
        Frame of the redshifts: "heliocentric", "cmb", "local-group"; "true" ones hold no velocities.
    dispersion : float
        Dispersion of radial velocities, those of flows among them. [km/s]
    cosmology : astropy cosmology
        The shape of the distance, and H_ref.
    density : SourceDensity
        Density of sources in space: of all where there is a luminosity function, else of those in the catalogue.
    luminosity : LuminosityFunction or None
        None where magnitudes are not used.
    errors : ErrorsByRedshift or None
        The variances that stand in place of the sources' own, where magnitudes are not used.
    notes : tuple of str
    limits : pair of float
        The smallest and largest redshift of the catalogue.
    flow_limits : pair of float
        Redshifts between which sources tell of a velocity: those of a catalogue that reaches far are not its largest.
    """

    frame: str
    dispersion: float
    cosmology: Cosmology
    density: SourceDensity
    luminosity: LuminosityFunction | None = None
    errors: ErrorsByRedshift | None = None
    notes: tuple[str, ...] = ()
    limits: tuple[float, float] = (np.nan, np.nan)
    flow_limits: tuple[float, float] = (np.nan, np.nan)

    @property
    def exact(self) -> bool:
        """Whether redshifts hold the expansion alone."""
        return self.frame == TRUE

    def redshift(self, field: Field) -> FloatArray:
        """Redshifts of a `field` at rest in the microwave background, (n,); nan where there is none.

        Raises
        ------
        FieldError
            If one is missing, not positive, or below the flow, when it is corrected.
        """
        if field.redshift is None or self.frame in (TRUE, "cmb"):
            transverse_distance(field.redshift, self.cosmology)  # which says what is missing
        assert field.redshift is not None
        corrected = to_cmb(field.redshift, field.lon, field.lat, field.frame, self.frame)
        lost = ~usable(corrected)
        if lost.any():
            at = lost.argmax()
            raise FieldError(
                f"{lost.sum()} of {len(field)} redshifts give no distance once they are taken from {self.frame} ones to"
                f" the frame of the microwave background: {count_unusable(corrected)} (first: row {at}, "
                f"{field.redshift[at]:.6f} → {corrected[at]:.6f}). Leave those sources out: "
                "vsh.models.cosmology.with_redshift(field), or --on-bad drop"
            )
        return corrected

    def log_distance(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ln d [Mpc] at `x` = ln(1 + z), and the logarithm of the volume for each x, but for a factor."""
        log_x = np.log(x)
        spline, slope = self._spline
        log_d = spline(log_x) + log_x
        return log_d, 3 * log_d + np.log1p(slope(log_x)) - log_x

    @cached_property
    def _spline(self):
        """ln d − ln x as a function of ln x, x = ln(1 + z), with its slope."""
        log_x = np.linspace(np.log(FLOW_LIMIT / 2), np.log(np.log(40.0)), 400)
        known = np.log(_distance(np.expm1(np.exp(log_x)), self.cosmology)) - log_x
        spline = make_interp_spline(log_x, known, k=5)
        return spline, spline.derivative()

    def spread(self, field: Field, redshift: FloatArray) -> FloatArray:
        """The error of ln(1 + z) of each source, (n,): of its velocity and its measurement.

        Parameters
        ----------
        field : Field
            The sources.
        redshift : (n,) array
            At rest in the microwave background.
        """
        variance = np.full(len(field), 0.0 if self.exact else (self.dispersion / SPEED_OF_LIGHT) ** 2)
        if field.redshift_error is not None:
            variance += (np.nan_to_num(field.redshift_error) / (1 + redshift)) ** 2
        return np.sqrt(variance)

    @property
    def little_h(self) -> float:
        """H_ref/100, by which Mpc become Mpc/h."""
        return hubble_value(self.cosmology) / 100


def _distance(redshift, cosmology):
    """Beyond the usable limits as well."""
    return transverse_distance(np.maximum(redshift, FLOW_LIMIT), cosmology) * np.where(
        redshift < FLOW_LIMIT, redshift / FLOW_LIMIT, 1.0
    )


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_REACH = 6.0
_BLOCK = 8192


@dataclass(frozen=True, eq=False)
class InverseDistances(InNotebook):
    """What is known of 1/d of each source, as the motion that 1 km/s gives."""

    mean: FloatArray
    variance: FloatArray
    slope: FloatArray
    own: BoolArray
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
        Calibration of its catalogue.
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
        blocks = list(map_blocks(block, unsure.size, _BLOCK, threads))
        mean[unsure], variance[unsure], slope[unsure] = np.concatenate(blocks, axis=1)
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
