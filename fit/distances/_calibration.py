"""What turns redshifts of a catalogue into distances: frame, velocities, density, luminosities."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline

from fit.distances._density import SourceDensity
from fit.distances._errors import ErrorsByRedshift
from fit.distances._luminosity import LuminosityFunction
from vsh.checks.notebook import InNotebook
from vsh.checks.types import Cosmology, FloatArray
from vsh.cosmology import FLOW_LIMIT, count_unusable, hubble_value, to_cmb, transverse_distance, usable
from vsh.errors import FieldError
from vsh.field import Field
from vsh.sky.redshift_frames import TRUE
from vsh.units import SPEED_OF_LIGHT


@dataclass(frozen=True, eq=False)
class Calibration(InNotebook):
    """How the distances of a catalogue follow from its redshifts.

    Attributes
    ----------
    frame : str
        Of the redshifts: "heliocentric", "cmb", "local-group"; "true" ones hold no velocities.
    dispersion : float
        Of radial velocities, those of flows among them. [km/s]
    cosmology : astropy cosmology
        The shape of the distance, and H_ref.
    density : SourceDensity
        Of sources in space: of all of them where there is a luminosity function, else of those in the catalogue.
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
        """Redshifts at rest in the microwave background, (n,); nan where there is none.

        Parameters
        ----------
        field : Field
            The sources.

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
                f"{lost.sum()} of {len(field)} redshifts give no distance once they are taken from {self.frame} ones to the frame of "
                f"the microwave background: {count_unusable(corrected)} (first: row {at}, {field.redshift[at]:.6f} → "
                f"{corrected[at]:.6f}). Leave those sources out: vsh.cosmology.with_redshift(field), or --on-bad drop"
            )
        return corrected

    def log_distance(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ln d [Mpc] at ln(1 + z), and the logarithm of the volume for each ln(1 + z), but for a factor.

        Parameters
        ----------
        x : array
            ln(1 + z)

        Returns
        -------
        tuple[array, array]
        """
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
