"""Distances of galaxies and quasars, by a flat cosmology of our own or any of astropy's."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import hyp2f1

from vsh.models.cosmology._apex import FLOW_LIMIT, count_unusable, usable
from vsh.tools.arguments import between as between_limits
from vsh.tools.arguments import explained, float_array
from vsh.tools.errors import ConvergenceError, FieldError, ParameterError
from vsh.tools.types import ArrayLike, Cosmology, FloatArray, Quantity
from vsh.tools.units import SPEED_OF_LIGHT


@dataclass(frozen=True)
class FlatLCDM:
    """A flat cosmology of matter and a cosmological constant, without astropy.cosmology's second to import.

    `H0` and `comoving_transverse_distance` are those of astropy's `FlatLambdaCDM(hubble, omega_m)`, which `to_astropy`
    gives.
    """

    hubble: float
    omega_m: float
    Ok0 = 0.0

    def distance(self, redshift: FloatArray) -> FloatArray:
        """Transverse comoving distance [Mpc]: Baes, Camps & Van De Putte (2017, MNRAS 468, 927), eq. 15."""
        s = ((1 - self.omega_m) / self.omega_m) ** (1 / 3)

        def integral(x):
            return 2 * np.sqrt(x) * hyp2f1(1 / 6, 1 / 2, 7 / 6, -(x**3))

        scale = SPEED_OF_LIGHT / self.hubble / np.sqrt(s * self.omega_m)
        return scale * (integral(s) - integral(s / (redshift + 1)))

    @property
    def H0(self) -> Quantity:
        """The Hubble constant as astropy's Quantity."""
        from astropy import units as u

        return self.hubble * u.km / u.s / u.Mpc

    def comoving_transverse_distance(self, redshift: ArrayLike) -> Quantity:
        """`distance` as astropy's Quantity."""
        from astropy import units as u

        return self.distance(np.asarray(redshift, float)) * u.Mpc

    def to_astropy(self) -> Any:
        """The same cosmology as astropy's `FlatLambdaCDM`."""
        from astropy.cosmology import FlatLambdaCDM

        return FlatLambdaCDM(self.hubble, self.omega_m)


#: Flat, Ω_m = 0.315, H0 = 67.3 km/s/Mpc: Bachchan, Hobbs & Lindegren (2016).
FLAT_PLANCK13 = FlatLCDM(67.3, 0.315)
#: More redshifts than this are interpolated.
_EXACT = 1000


@explained
def transverse_distance(
    redshift: ArrayLike | None, cosmology: Cosmology | None = None, *, hubble: float | None = None
) -> FloatArray:
    """Transverse comoving distance d_M, (n,). [Mpc]

    Parameters
    ----------
    redshift : (n,) array
        One for each source.
    cosmology : astropy cosmology, optional
        Its shape; its H0 too unless `hubble` is given; flat, Ω_m = 0.315, H0 = 67.3 unless given.
    hubble : float, optional
        H0, to which distances are inversely proportional [km/s/Mpc]

    Raises
    ------
    FieldError
        If any redshift is missing, not positive, or below the flow (z < 1e-4): astropy would
        return 0 Mpc for a nan and a negative distance for a negative redshift.

    Notes
    -----
    More than a thousand redshifts are interpolated, to 1e-9 of the distance or better.

    Examples
    --------
    >>> transverse_distance(np.array([0.001, 0.01, 1.0])).round(2)
    array([   4.45,   44.44, 3406.32])
    """
    if redshift is None:
        raise FieldError("these sources have no redshifts, which a distance needs")
    cosmology = FLAT_PLANCK13 if cosmology is None else _checked(cosmology)
    redshift = float_array("redshift", redshift, finite=False)
    if not redshift.size:
        raise FieldError("there are no redshifts to take distances of")
    good = usable(redshift)
    if not good.all():
        raise FieldError(
            f"{(~good).sum()} of {redshift.size} redshifts give no distance: {count_unusable(redshift)}. "
            "Leave those sources out first: vsh.models.cosmology.with_redshift(field), or --on-bad drop"
        )
    farthest = _exact(np.linspace(redshift.min(), redshift.max(), 64), cosmology)
    if not (farthest > 0).all():
        raise FieldError(
            f"redshifts up to {redshift.max():.3g} reach beyond the antipode of this closed cosmology, where distances "
            "are not positive: leave them out, or lower its densities"
        )
    distance = (_interpolated if redshift.size > _EXACT else _exact)(redshift, cosmology)
    return distance if hubble is None else distance * (hubble_value(cosmology) / hubble)


@explained
def distance_modulus(distance: ArrayLike, redshift: ArrayLike) -> FloatArray:
    """Apparent less absolute magnitude, 5 lg(d_M (1 + z)) + 25.

    Parameters
    ----------
    distance : (n,) array
        Transverse comoving distance. [Mpc]
    redshift : (n,) array
        One for each source.
    """
    return 5 * np.log10(np.asarray(distance) * (1 + np.asarray(redshift))) + 25


def redshift_of(distance: ArrayLike, cosmology: Cosmology | None = None) -> FloatArray:
    """The redshift at each transverse comoving distance [Mpc], (n,); nan where the distance is.

    To the antipode of a closed cosmology, and to z = 1000.
    """
    cosmology = FLAT_PLANCK13 if cosmology is None else cosmology
    from scipy.interpolate import make_interp_spline  # slow to import

    grid = np.geomspace(FLOW_LIMIT, 1000.0, 4000)
    known = _exact(grid, cosmology)
    rising = slice(0, int(np.argmax(known)) + 1)
    spline = make_interp_spline(np.log(known[rising]), np.log(grid[rising]), k=3)
    distance = np.asarray(distance, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.exp(spline(np.clip(np.log(distance), np.log(known[0]), np.log(known[rising][-1]))))


def flat(omega_m: float) -> Cosmology:
    """A flat cosmology with a cosmological constant; ParameterError unless 0.001 < Ω_m < 2."""
    between_limits("omega_m", omega_m, 0.001, 2)
    return FlatLCDM(FLAT_PLANCK13.hubble, omega_m)


def hubble_value(cosmology: Cosmology) -> float:
    """The Hubble constant of a cosmology. [km/s/Mpc]"""
    if isinstance(cosmology, FlatLCDM):
        return cosmology.hubble
    return float(_checked(cosmology).H0.to_value("km / (s Mpc)"))


def parallax_factor(distance: ArrayLike, cosmology: Cosmology | None = None) -> FloatArray:
    """By what sources move more by our own motion than at the same transverse distance in flat space: d_M/d_P, (n,).

    Our velocity moves a source by v/d_P with d_P = d_M/√(1 + Ω_k (d_M H0/c)²), its own by v/d_M (Weinberg 1972,
    Gravitation and Cosmology, sect. 14.4).
    """
    distance = np.asarray(distance, float)
    if cosmology is None or not _checked(cosmology).Ok0:
        return np.ones_like(distance)
    curvature = float(cosmology.Ok0)
    return np.sqrt(np.maximum(1 + curvature * (distance * hubble_value(cosmology) / SPEED_OF_LIGHT) ** 2, 0.0))


def _checked(cosmology):
    if isinstance(cosmology, FlatLCDM):  # whose H0 would load astropy's units
        return cosmology
    if not (hasattr(cosmology, "H0") and hasattr(cosmology, "comoving_transverse_distance")):
        raise ParameterError(
            f"cosmology is one of astropy's, FlatLambdaCDM(H0=70, Om0=0.3) say, not a {type(cosmology).__name__} "
            "(CMB_VELOCITY_PLANCK18 of vsh.models.cosmology is our velocity, that of vsh.models.flows a theory of "
            "flows)"
        )
    return cosmology


def _exact(redshift, cosmology):
    if isinstance(cosmology, FlatLCDM):
        return cosmology.distance(redshift)
    return cosmology.comoving_transverse_distance(redshift).to_value("Mpc")


def _interpolated(redshift, cosmology, accuracy=1e-9):
    """By a quintic spline of log(d/z) in log(1 + z), refined until it holds between its nodes."""
    low, high = np.log1p(redshift.min()), np.log1p(redshift.max()) + 1e-12
    from scipy.interpolate import make_interp_spline  # slow to import

    nodes = 32
    while nodes <= 4096:
        x = np.linspace(low, high, nodes + 1)
        z = np.expm1(x)
        spline = make_interp_spline(x, np.log(_exact(z, cosmology) / z), k=5)
        between = (x[1:] + x[:-1]) / 2
        z = np.expm1(between)
        if np.abs(spline(between) - np.log(_exact(z, cosmology) / z)).max() < accuracy / 4:
            return redshift * np.exp(spline(np.log1p(redshift)))
        nodes *= 2
    raise ConvergenceError(f"the distances of {cosmology} are too rough to interpolate")
