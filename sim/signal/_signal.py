"""The noun: true fields as functions of position and redshift that add; spin and acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vsh import Coefficients
from vsh.checks.arrays import float_array
from vsh.checks.notebook import InNotebook
from vsh.checks.types import ArrayLike, FloatArray
from vsh.checks.validation import as_floats
from vsh.errors import FieldError, ParameterError
from vsh.sky.sphere import triad
from vsh.units import SPEED_OF_LIGHT


class Observer:
    """Base of signals by our own velocity, toward the apex. [km/s]"""

    velocity: FloatArray


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

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None = None) -> FloatArray:
        lon, lat = np.atleast_1d(float_array("lon", lon)), np.atleast_1d(float_array("lat", lat))
        return sum(part(lon, lat, redshift) for part in self.parts)

    def observed_redshift(
        self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike, frame: str = "heliocentric"
    ) -> FloatArray:
        """Redshifts as they are measured, without errors: (1 + z)(1 + v_r/c), over (1 + v·r/c) for the Sun's, (n,).

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        redshift : (n,) array
            Of the expansion alone.
        frame : {"heliocentric", "cmb", "true"}
            Seen from the Sun, whose velocity v is that of the signal's secular parallax; at rest in the microwave
            background; or as they are.

        Raises
        ------
        ParameterError
            If the frame is another.
        """
        lon, lat, redshift = (np.atleast_1d(float_array("lon", x, finite=False)) for x in (lon, lat, redshift))
        if frame not in ("heliocentric", "cmb", "true"):
            raise ParameterError(f"redshifts are observed as heliocentric, cmb or true ones, not {frame!r}")
        if frame == "true":
            return redshift
        outward = sum(part.radial(lon, lat, redshift) for part in self.parts if hasattr(part, "radial"))
        seen = (1 + redshift) * (1 + outward / SPEED_OF_LIGHT)
        if frame == "heliocentric":
            ours = sum(part.velocity @ triad(lon, lat)[2] for part in self.parts if isinstance(part, Observer))
            seen = seen / (1 + ours / SPEED_OF_LIGHT)
        return seen - 1

    def __repr__(self) -> str:
        return f"<Signal: {' + '.join(type(part).__name__ for part in self.parts)}>"

    def __add__(self, other: Any) -> Signal:
        return Signal(self.parts + as_signal(other).parts)


def as_signal(truth: Any) -> Signal:
    """Coefficients, Signals, and functions of (lon, lat, redshift) that give (2, n) µas/yr, as a Signal."""
    if isinstance(truth, Coefficients):
        return from_coefficients(truth)
    if not callable(truth):
        raise ParameterError(f"a true field is a Signal or Coefficients, not {type(truth).__name__}")
    return truth if isinstance(truth, Signal) else Signal((truth,))


@dataclass(frozen=True)
class BandLimited:
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
    """
    if not isinstance(coefficients, Coefficients):
        raise ParameterError(f"a field is made of Coefficients, not {type(coefficients).__name__}")
    return Signal((BandLimited(coefficients),))


def spin(vector: ArrayLike) -> Signal:
    """Rigid rotation of the frame, ω × r. [µas/yr]

    Parameters
    ----------
    vector : (3,) array
        ω. [µas/yr]
    """
    return from_coefficients(Coefficients.from_vectors(rotation=three_components(vector, "spin", "uas / yr")))


def acceleration(vector: ArrayLike) -> Signal:
    """Apparent motion towards the direction of the Solar System's acceleration ã: ã − (ã·r) r. [µas/yr]

    Parameters
    ----------
    vector : (3,) array
        ã. [µas/yr]
    """
    return from_coefficients(Coefficients.from_vectors(glide=three_components(vector, "acceleration", "uas / yr")))


def three_components(value: Any, name: str, unit: str = "") -> FloatArray:
    """Three finite components, bare or as a Quantity of any fitting unit."""
    value = as_floats(name, value, unit)[0]
    if value.shape != (3,) or not np.isfinite(value).all():
        raise FieldError(f"{name} must be a vector of three finite components, not of shape {value.shape}")
    return value


def direction_of(value: Any, name: str, unit: str = "") -> FloatArray:
    """Three finite components that are not all zero, bare or as a Quantity."""
    value = three_components(value, name, unit)
    if not value.any():
        raise FieldError(f"{name} must be a vector whose components are not all zero")
    return value
