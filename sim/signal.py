"""True fields: functions of position and redshift that add."""

from dataclasses import dataclass

import numpy as np

from vsh import Coefficients, Modes, arguments
from vsh.arguments import float_array, generator, not_negative, number, positive, whole
from vsh.errors import FieldError, ParameterError
from vsh.gate import as_floats
from vsh.sphere import triad
from vsh.units import AU_PER_YEAR


@dataclass(frozen=True, repr=False)
class Signal:
    """A true field of motions: called as signal(lon, lat, redshift) → (2, n) µas/yr, added with +.

    Attributes
    ----------
    parts : tuple of functions of (lon, lat, redshift)

    Examples
    --------
    >>> both = spin((1, 0, 0)) + acceleration((0, 0, 2))
    >>> both([0.0], [0.0]).round(12).T
    array([[0., 2.]])
    """

    parts: tuple

    def __call__(self, lon, lat, redshift=None):
        lon, lat = np.atleast_1d(float_array("lon", lon)), np.atleast_1d(float_array("lat", lat))
        return sum(part(lon, lat, redshift) for part in self.parts)

    def __repr__(self):
        return f"<Signal: {' + '.join(type(part).__name__ for part in self.parts)}>"

    def __add__(self, other):
        return Signal(self.parts + as_signal(other).parts)


def as_signal(truth):
    """Coefficients, Signals, and functions of (lon, lat, redshift) that give (2, n) µas/yr, as a Signal.

    Raises
    ------
    ParameterError
        If it is neither.
    """
    if isinstance(truth, Coefficients):
        return field(truth)
    if not callable(truth):
        raise ParameterError(f"a true field is a Signal or Coefficients, not {type(truth).__name__}")
    return truth if isinstance(truth, Signal) else Signal((truth,))


@dataclass(frozen=True)
class BandLimited:
    """A field of harmonics."""

    coefficients: Coefficients

    def __call__(self, lon, lat, redshift):
        return self.coefficients.at(lon, lat)


@dataclass(frozen=True)
class Drift:
    """Parallax by our velocity [km/s, toward the apex]."""

    velocity: np.ndarray
    cosmology: object
    hubble: float | None

    def __call__(self, lon, lat, redshift):
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
    waves: int

    def __call__(self, lon, lat, redshift):
        draw = np.random.default_rng(self.seed)
        distance = _distance(redshift, self.cosmology, self.hubble)
        p, q, r = triad(lon, lat)
        if self.length is None:
            return self.sigma * draw.standard_normal((2, len(lon))) / (AU_PER_YEAR * distance)
        numbers = draw.standard_normal((self.waves, 3)) / self.length
        phases = draw.uniform(0, 2 * np.pi, self.waves)
        amplitudes = draw.standard_normal((3, self.waves)) * self.sigma * np.sqrt(2 / self.waves)
        velocity = np.empty((3, len(lon)))
        for start in range(0, len(lon), 8192):
            block = slice(start, start + 8192)
            velocity[:, block] = amplitudes @ np.cos(numbers @ (r * distance)[:, block] + phases[:, None])
        return np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)]) / (AU_PER_YEAR * distance)


@dataclass(frozen=True)
class Shear:
    """Axes that expand at different rates [µas/yr]."""

    matrix: np.ndarray

    def __call__(self, lon, lat, redshift):
        p, q, r = triad(lon, lat)
        return np.stack([np.sum(p * (self.matrix @ r), 0), np.sum(q * (self.matrix @ r), 0)])


@dataclass(frozen=True)
class Void:
    """A dipole that grows with redshift to `peak` and fades again."""

    glide: Coefficients
    peak: float

    def __call__(self, lon, lat, redshift):
        if redshift is None:
            raise FieldError("the void's dipole depends on redshift, and these sources have none")
        x = np.asarray(redshift, float) / self.peak
        return self.glide.at(lon, lat) * x * np.exp(1 - x)


def field(coefficients):
    """Any band-limited field."""
    if not isinstance(coefficients, Coefficients):
        raise ParameterError(f"a field is made of Coefficients, not {type(coefficients).__name__}")
    return Signal((BandLimited(coefficients),))


def spin(vector):
    """Rigid rotation of the frame, ω × r. [µas/yr]"""
    return field(Coefficients.from_vectors(rotation=_three(vector, "spin", "uas / yr")))


def acceleration(vector):
    """Drift towards a point by the Solar System's acceleration, ã − (ã·r) r. [µas/yr]"""
    return field(Coefficients.from_vectors(glide=_three(vector, "acceleration", "uas / yr")))


def drift(velocity, cosmology=None, hubble=None):
    """Parallax by our own motion through the Universe: µ = −v_⊥/d_M, towards the antapex.

    Parameters
    ----------
    velocity : (3,) array — ours with respect to the background, towards the apex, along the
        axes of the frame [km/s]
    cosmology : astropy cosmology, optional — flat, Ω_m = 0.315, H0 = 67.3 unless given
    hubble : float, optional — H0 in place of the cosmology's [km/s/Mpc]

    Notes
    -----
    Bachchan, Hobbs & Lindegren (2016), sect. 2.3.
    """
    hubble = None if hubble is None else positive("hubble", hubble)
    return Signal((Drift(_vector(velocity, "velocity", "km / s"), cosmology, hubble),))


@arguments.accepts(rng=arguments.seed)
def peculiar(sigma, rng, length=None, cosmology=None, hubble=None, waves=256):
    """Random velocities of the galaxies, in each component a Gaussian of standard deviation `sigma`.

    Parameters
    ----------
    sigma : float — [km/s]
    rng : Generator or int — drawn from once, here: the same signal gives the same sky again
    length : float, optional — velocities r apart are correlated by exp(−r²/(2 length²));
        independent unless given [Mpc]
    cosmology, hubble
        As for `drift`.
    waves : int — plane waves that make up a correlated field
    """
    length = None if length is None else positive("length", length)
    hubble = None if hubble is None else positive("hubble", hubble)
    seed = int(generator(rng).integers(2**63))
    return Signal((Peculiar(not_negative("sigma", sigma), seed, length, cosmology, hubble, whole("waves", waves)),))


@arguments.accepts(rng=arguments.seed)
def isotropic(power, rng):
    """A Gaussian random field with a given power of each degree, the same for T and S.

    Parameters
    ----------
    power : (lmax,) array — ∫ |V_l|² dΩ of one kind, on average [(µas/yr)²]
    rng : Generator or int
    """
    power = float_array("power", power)
    if power.ndim != 1 or not len(power) or (power < 0).any():
        raise ParameterError("power is one number of at least zero for each degree from 1 on")
    modes = Modes(len(power))
    l = modes.degrees
    sigma = np.sqrt(power[l - 1] / (2 * l + 1) / modes.multiplicity)
    return field(Coefficients(modes, sigma * generator(rng).standard_normal(len(modes))))


def wave_fractions(lmax):
    """Share of each degree in the power of an isotropic gravitational-wave background, (lmax,).

    α_l = 24 (2l + 1) / [(l − 1) l² (l + 1)² (l + 2)]: 5/6, 7/60, 3/100, … from l = 2 on; they
    sum to 1. The fractions are those of Book & Flanagan (2011, PhRvD 83, 024024), table 1.

    >>> wave_fractions(4).round(6)
    array([0.      , 0.833333, 0.116667, 0.03    ])
    """
    l = np.arange(2, lmax + 1.0)
    return np.r_[0.0, 24 * (2 * l + 1) / ((l - 1) * l**2 * (l + 1) ** 2 * (l + 2))]


def waves(omega, rng, hubble=70.0, lmax=12):
    """One draw of a stochastic background of gravitational waves longer than the observations.

    Its mean square motion is H0² Ω_GW, so that the quadrupole obeys
    Ω_GW = (6/5) P_2/(4π H0²), half of P_2 in T and half in S.

    Parameters
    ----------
    omega : float — Ω_GW
    rng : Generator or int
    hubble : float — [km/s/Mpc]
    """
    total = 4 * np.pi * not_negative("omega", omega) * hubble_rate(hubble) ** 2
    return isotropic(total * wave_fractions(lmax) / 2, rng)


def hubble_rate(hubble):
    """H0 as an angular rate, as angles would change in an expansion on one axis only. [µas/yr]

    >>> round(hubble_rate(67.3), 4), round(hubble_rate(70), 4)
    (14.1969, 14.7665)
    """
    # d = 1 Mpc recedes at `hubble` km/s: the angle v / d.
    return hubble / AU_PER_YEAR


def anisotropic_expansion(shear):
    """A Bianchi I universe: axes expand at rates that differ, µ = Σ r − (rᵀ Σ r) r.

    Parameters
    ----------
    shear : (3, 3) array — Σ, symmetric: the expansion rate along each axis less the mean; a
        trace makes no difference [µas/yr]; 1 % of H0 = 70 is 0.15 µas/yr

    Notes
    -----
    The 0.2 µas/yr of Bachchan et al. (2016) is Quercellini et al.'s (2009) for 1 %.
    """
    shear = float_array("shear", shear, (3, 3))
    if not np.allclose(shear, shear.T):
        raise ParameterError("the shear must be a symmetric 3 × 3 matrix")
    return Signal((Shear(shear),))


def void(direction, amplitude=0.02, peak=1.0):
    """We are off the centre of a large void: a dipole that grows with redshift and fades again.

    µ = A f(z) (e − (e·r) r), f = (z/z_p) e^{1 − z/z_p}. The amplitude is that of Bachchan et al.
    (2016, Table 1); the profile is a description of theirs ("increases at high z, decreases at
    very high z"), not the solution of a model.

    Parameters
    ----------
    direction : (3,) array — towards which sources move; only its direction counts
    amplitude : float — the largest motion [µas/yr]
    peak : float — z_p, the redshift of the largest motion
    """
    direction = _vector(direction, "direction")
    glide = number("amplitude", amplitude) * direction / np.linalg.norm(direction)
    return Signal((Void(Coefficients.from_vectors(glide=glide), positive("peak", peak)),))


def _three(value, name, unit=""):
    """Three finite components, bare or as a Quantity of any fitting unit."""
    value = as_floats(name, value, unit)[0]
    if value.shape != (3,) or not np.isfinite(value).all():
        raise FieldError(f"{name} must be a vector of three finite components, not of shape {value.shape}")
    return value


def _vector(value, name, unit=""):
    value = _three(value, name, unit)
    if not value.any():
        raise FieldError(f"{name} must be a vector whose components are not all zero")
    return value


def _distance(redshift, cosmology, hubble):
    from vsh.cosmology import PAPER, transverse_distance  # astropy

    return transverse_distance(redshift, PAPER if cosmology is None else cosmology, hubble)
