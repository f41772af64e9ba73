"""The noun: true fields as functions of position and redshift that add; spin and acceleration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np

from vsh import Coefficients
from vsh.models.covariance import Spectrum
from vsh.models.waves import unit_vector, wave_motions
from vsh.modes import as_modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import float_array, generator, not_negative, number
from vsh.tools.bad_rows import as_floats_and_mask
from vsh.tools.errors import FieldError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, Axes, FloatArray, Rng
from vsh.tools.units import SPEED_OF_LIGHT


class ObserverMotion:
    """Base of signals by our own velocity, toward the apex. [km/s]"""

    velocity: FloatArray


class TimeDependent:
    """Base of displacements that change with time: no motions, so that `sim.epochs` alone can show them."""

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None) -> FloatArray:
        raise ParameterError("a signal that changes within the mission has no proper motion: sim.epochs shows it")

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        raise NotImplementedError


@dataclass(frozen=True, repr=False)
class Signal(InNotebook):
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

    def plot(self, redshift: float | None = None, *, ax: Axes | None = None) -> Axes:
        """The motions on the sky as arrows, on matplotlib axes.

        Parameters
        ----------
        redshift : float, optional
            The redshift of all sources, for a signal that depends on it.
        ax : matplotlib axes, optional
            Axes whose place the map takes; a new figure unless given.
        """
        from vsh.figures import plot

        axes = plot.sky_axes(ax=ax, below=0.5)
        lon, lat = plot.arrow_grid(axes)
        motion = self(lon, lat, None if redshift is None else np.full(len(lon), float(redshift)))
        plot.draw_vectors(axes, lon, lat, motion)
        if motion.any():
            plot.draw_arrow_key(axes, float(np.hypot(*motion).max()), "µas/yr")
        return axes

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None = None) -> FloatArray:
        lon, lat = np.atleast_1d(float_array("lon", lon)), np.atleast_1d(float_array("lat", lat))
        return sum((component(lon, lat, redshift) for component in self.parts), np.zeros((2, len(lon))))

    @property
    def steady(self) -> Signal:
        """Part that is proper motion."""
        return Signal(tuple(component for component in self.parts if not isinstance(component, TimeDependent)))

    @property
    def changes(self) -> bool:
        """Return whether something of it changes within the mission."""
        return any(isinstance(component, TimeDependent) for component in self.parts)

    def displacement(self, lon: ArrayLike, lat: ArrayLike, time: ArrayLike) -> FloatArray:
        """Displacements by what changes within the mission, (2, k), a source and a time each. [µas]

        Parameters
        ----------
        lon, lat : (k,) arrays
            Positions. [rad]
        time : (k,) array
            Since the reference epoch. [yr]
        """
        lon, lat, time = (np.atleast_1d(float_array("positions and times", values)) for values in (lon, lat, time))
        displacements = [
            component.displacement(lon, lat, time) for component in self.parts if isinstance(component, TimeDependent)
        ]
        return sum(displacements, np.zeros((2, len(time))))

    def observed_redshift(
        self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike, frame: str = "heliocentric"
    ) -> FloatArray:
        """Redshifts as they are measured, without errors: (1 + z)(1 + v_r/c), over (1 + v·r/c) for the Sun's, (n,).

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        redshift : (n,) array
            Redshifts of the expansion alone.
        frame : {"heliocentric", "cmb", "true"}
            Seen from the Sun, whose velocity v is that of the signal's secular parallax; at rest in the microwave
            background; or as they are.

        Raises
        ------
        ParameterError
            If the frame is another.
        """
        inputs = {"lon": lon, "lat": lat, "redshift": redshift}
        lon, lat, redshift = (np.atleast_1d(float_array(name, values, finite=False)) for name, values in inputs.items())
        if frame not in ("heliocentric", "cmb", "true"):
            raise ParameterError(f"redshifts are observed as heliocentric, cmb or true ones, not {frame!r}")
        if frame == "true":
            return redshift
        radial = sum(component.radial(lon, lat, redshift) for component in self.parts if hasattr(component, "radial"))
        wavelength_ratio = (1 + redshift) * (1 + radial / SPEED_OF_LIGHT)
        if frame == "heliocentric":
            our_velocity = sum(
                component.velocity @ triad(lon, lat)[2]
                for component in self.parts
                if isinstance(component, ObserverMotion)
            )
            wavelength_ratio = wavelength_ratio / (1 + our_velocity / SPEED_OF_LIGHT)
        return wavelength_ratio - 1

    def __repr__(self) -> str:
        return f"<Signal: {' + '.join(type(component).__name__ for component in self.parts)}>"

    def __add__(self, other: Any) -> Signal:
        return Signal(self.parts + as_signal(other).parts)

    def __mul__(self, factor: Any) -> Signal:
        """Multiply the field by a number."""
        if not isinstance(factor, (int, float, np.number)):
            return NotImplemented
        return Signal(
            tuple(_scale_component(component, number("the factor of a signal", factor)) for component in self.parts)
        )

    __rmul__ = __mul__

    def __neg__(self) -> Signal:
        return self * -1.0


def _scale_component(component, factor):
    """A part of a signal, so many times as large; our own velocity stays one, for redshifts."""
    if isinstance(component, ObserverMotion):
        return replace(cast(Any, component), velocity=factor * np.asarray(component.velocity, float))
    if isinstance(component, ScaledSignal):
        return replace(component, factor=factor * component.factor)
    if hasattr(component, "radial"):
        raise ParameterError(f"a {type(component).__name__} has redshifts beside motions, which cannot be multiplied")
    return (ScaledInTime if isinstance(component, TimeDependent) else ScaledSignal)(component, factor)


@dataclass(frozen=True)
class ScaledSignal:
    """A field, so many times as large."""

    part: Any
    factor: float

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None) -> FloatArray:
        return self.factor * self.part(lon, lat, redshift)


@dataclass(frozen=True)
class ScaledInTime(TimeDependent, ScaledSignal):
    """A field that changes with time, so many times as large."""

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        return self.factor * self.part.displacement(lon, lat, time)


def as_signal(truth: Any) -> Signal:
    """Coefficients, Signals, and functions of (lon, lat, redshift) that give (2, n) µas/yr, as a Signal."""
    if isinstance(truth, Coefficients):
        return from_coefficients(truth)
    if not callable(truth):
        raise ParameterError(f"a true field is a Signal or Coefficients, not {type(truth).__name__}")
    return truth if isinstance(truth, Signal) else Signal((truth,))


@dataclass(frozen=True)
class BandLimitedSignal:
    """A field of harmonics."""

    coefficients: Coefficients

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None) -> FloatArray:
        return self.coefficients.at(lon, lat)


def from_coefficients(coefficients: Coefficients) -> Signal:
    """Any band-limited field.

    Parameters
    ----------
    coefficients : Coefficients
        The field. [µas/yr]

    Raises
    ------
    ParameterError
        If they are no Coefficients.

    Examples
    --------
    >>> from vsh import Coefficients, Modes
    >>> signal = from_coefficients(Coefficients(Modes(1), [0, 0, 0, 10.0, 0, 0]))
    >>> signal(np.array([1.0, 2.0]), np.array([0.0, 0.5])).shape
    (2, 2)
    """
    if not isinstance(coefficients, Coefficients):
        raise ParameterError(f"a field is made of Coefficients, not {type(coefficients).__name__}")
    return Signal((BandLimitedSignal(coefficients),))


def spin(vector: ArrayLike) -> Signal:
    """Rigid rotation of the frame, ω × r. [µas/yr]

    Parameters
    ----------
    vector : (3,) array
        ω. [µas/yr]

    Examples
    --------
    >>> signal = spin((0, 0, 10.0))
    >>> signal(np.array([1.0]), np.array([0.0])).round(6).ravel().tolist()  # along the equator
    [10.0, 0.0]
    """
    return from_coefficients(Coefficients.from_vectors(rotation=check_vector(vector, "spin", "uas / yr")))


def acceleration(vector: ArrayLike) -> Signal:
    """Apparent motion towards the direction of the Solar System's acceleration ã: ã − (ã·r) r. [µas/yr]

    Parameters
    ----------
    vector : (3,) array
        ã. [µas/yr]

    Examples
    --------
    >>> signal = acceleration((0, 0, 5.0))
    >>> signal(np.array([1.0]), np.array([0.0])).round(6).ravel().tolist()  # towards the pole
    [0.0, 5.0]
    """
    return from_coefficients(Coefficients.from_vectors(glide=check_vector(vector, "acceleration", "uas / yr")))


def check_vector(vector: Any, name: str, unit: str = "") -> FloatArray:
    """Three finite components, bare or as a Quantity of any fitting unit."""
    vector = as_floats_and_mask(name, vector, unit)[0]
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise FieldError(f"{name} must be a vector of three finite components, not of shape {vector.shape}")
    return vector


def check_nonzero_vector(vector: Any, name: str, unit: str = "") -> FloatArray:
    """Three finite components that are not all zero, bare or as a Quantity."""
    vector = check_vector(vector, name, unit)
    if not vector.any():
        raise FieldError(f"{name} must be a vector whose components are not all zero")
    return vector


@dataclass(frozen=True)
class Shear:
    """Axes that expand at different rates [µas/yr]."""

    matrix: FloatArray

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike) -> FloatArray:
        p, q, r = triad(lon, lat)
        return np.stack([np.sum(p * (self.matrix @ r), 0), np.sum(q * (self.matrix @ r), 0)])


def anisotropic_expansion(shear: ArrayLike) -> Signal:
    """A Bianchi I universe: axes expand at rates that differ, µ = Σ r − (rᵀ Σ r) r.

    Parameters
    ----------
    shear : (3, 3) array
        Σ, symmetric: the expansion rate along each axis less the mean; a
        trace makes no difference [µas/yr]; 1 % of H0 = 70 is 0.15 µas/yr.

    Raises
    ------
    ParameterError
        If the matrix is not symmetric.

    Notes
    -----
    The 0.2 µas/yr of Bachchan et al. (2016) is Quercellini et al.'s (2009) for 1 %.

    Examples
    --------
    >>> signal = anisotropic_expansion(np.diag([0.01, 0.01, -0.02]))
    >>> signal(np.array([0.0]), np.array([0.5])).shape
    (2, 1)
    """
    shear = float_array("shear", shear, (3, 3))
    if not np.allclose(shear, shear.T):
        raise ParameterError("the shear must be a symmetric 3 × 3 matrix")
    return Signal((Shear(shear),))


@arguments.accepts(rng=arguments.seed)
def systematics(
    spectrum: Spectrum | Callable[[FloatArray], FloatArray],
    rng: Rng,
    *,
    parity: Literal["odd", "even"] | None = None,
    lmax: int = 24,
) -> Signal:
    """Errors that a catalogue shares over the sky: one draw of a Gaussian field of a given spectrum.

    Parameters
    ----------
    spectrum : Spectrum or function of θ [rad]
        The mean power of each kind and degree, or the covariance V(θ) of motions at an angle θ, such as
        `vsh.models.covariance.LINDEGREN_2021`. [(µas/yr)²]
    rng : Generator or int
        The source of all randomness.
    parity : {"odd", "even"}, optional
        Only the fields that a spin belongs to, or only those a glide belongs to; both unless given.
    lmax : int
        The highest degree of the field; 24 resolves 7°.

    Examples
    --------
    >>> field = systematics(5 * Spectrum.odd() + 20 * Spectrum.even(), rng=1)
    >>> field(np.zeros(3), np.zeros(3)).shape
    (2, 3)
    """
    if not isinstance(spectrum, Spectrum):
        spectrum = Spectrum.from_covariance(spectrum)
    if parity is not None:
        spectrum = spectrum.only(parity)
    modes = as_modes(lmax)
    sigma = np.sqrt(spectrum.variances(modes))
    return from_coefficients(Coefficients(modes, sigma * generator(rng).standard_normal(len(modes))))


@arguments.accepts(rng=arguments.seed)
def random_field(power: ArrayLike, rng: Rng) -> Signal:
    """A Gaussian random field with a given power of each degree, the same for T and S.

    Parameters
    ----------
    power : (lmax,) array
        ∫ |V_l|² dΩ of one kind, on average [(µas/yr)²]
    rng : Generator or int
        The source of all randomness.

    Examples
    --------
    >>> random_field([5.0, 2.0], 1)(np.array([0.0]), np.array([0.3])).shape  # degrees 1 and 2
    (2, 1)
    """
    return systematics(Spectrum.given(power), rng, lmax=np.size(power))


def wave_background(omega: float, rng: Rng, *, hubble: float = 70.0, lmax: int = 12) -> Signal:
    """Draw a stochastic background of gravitational waves longer than the observations.

    Its mean square motion is H0² Ω_GW, so that the quadrupole obeys
    Ω_GW = (6/5) P_2/(4π H0²), half of P_2 in T and half in S.

    Parameters
    ----------
    omega : float
        Ω_GW.
    rng : Generator or int
        The source of all randomness.
    hubble : float
        [km/s/Mpc]
    lmax : int
        The highest degree.

    Examples
    --------
    >>> wave_background(1e-4, 1, lmax=4)(np.array([0.0]), np.array([0.3])).shape
    (2, 1)
    """
    return systematics(not_negative("omega", omega) * Spectrum.waves(hubble), rng, lmax=lmax)


@dataclass(frozen=True)
class PlaneWave:
    """Motions by one wave. [µas/yr]"""

    direction: FloatArray
    plus: float
    cross: float

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None) -> FloatArray:
        return wave_motions(lon, lat, self.direction, self.plus, self.cross)


def plane_wave(direction: ArrayLike, plus: float, cross: float = 0.0) -> Signal:
    """Make a plane gravitational wave, much longer than the observations: its motions at the Earth, exactly.

    Parameters
    ----------
    direction : (3,) array
        Where it travels to, along the axes of the frame; of any length. Its source is on the other side of the sky.
    plus, cross : float
        Rates of the strain in two polarisations: south–south less east–east at `direction`, and south–east. A strain h
        of frequency f has 2πf h; 1 µas/yr is h = 2.4e-11 at 1 nHz (`vsh.models.waves.compute_strain`). [µas/yr]

    Notes
    -----
    Pyne et al. (1996, ApJ 465, 566), Book & Flanagan (2011, PRD 83, 024024), eq. 58; only what happens at the Earth,
    which all sources share. ∫|V|² dΩ = (2π/3)(plus² + cross²).

    Examples
    --------
    >>> plane_wave((0, 0, 1), 2.0)([0.0], [0.0]).round(12).ravel()
    array([0., 1.])
    """
    return Signal((PlaneWave(unit_vector(direction), number("plus", plus), number("cross", cross)),))
