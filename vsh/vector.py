"""A vector with its covariance: a spin, an acceleration, an orientation or a velocity."""

from dataclasses import dataclass, replace

import numpy as np

from vsh.frames import check_frame, rotation_matrix
from vsh.sphere import angles, triad


@dataclass(frozen=True, eq=False)
class Vector:
    """A 3-vector along the axes of a frame.

    Attributes
    ----------
    value : (3,) array
        Components x, y, z. [`unit`]
    covariance : (3, 3) array
        Of the components. [the square of `unit`]
    frame : str
        "icrs", "galactic" or "ecliptic".
    unit : str
        "µas/yr" unless said otherwise.

    Examples
    --------
    >>> a = Vector([4.3, 0, 0], 0.01 * np.eye(3), frame="galactic").to_frame("icrs")
    >>> a.value.round(3), round(a.amplitude, 3), round(a.amplitude_error, 3)
    (array([-0.236, -3.756, -2.08 ]), 4.3, 0.1)
    >>> "{:.1f}°, {:.1f}°".format(*a.direction)
    '266.4°, -28.9°'
    """

    value: np.ndarray
    covariance: np.ndarray
    frame: str = "icrs"
    unit: str = "µas/yr"

    def __post_init__(self):
        object.__setattr__(self, "value", np.asarray(self.value, float))
        object.__setattr__(self, "covariance", np.asarray(self.covariance, float))
        check_frame(self.frame)
        if self.value.shape != (3,) or self.covariance.shape != (3, 3):
            raise ValueError(
                f"a Vector has 3 components and a 3 × 3 covariance, not {self.value.shape} and {self.covariance.shape}"
            )

    @classmethod
    def from_polar(cls, amplitude, lon, lat, errors=(0.0, 0.0, 0.0), frame="icrs", unit="µas/yr"):
        """A vector of known length and direction.

        Parameters
        ----------
        amplitude : float — [`unit`]
        lon, lat : float — [deg]
        errors : (3,) array — standard errors of these three, uncorrelated; that of the longitude
            not times cos(lat)

        Examples
        --------
        >>> Vector.from_polar(4.3, 0, 0, frame="galactic").value
        array([4.3, 0. , 0. ])
        """
        p, q, r = triad(np.radians(lon), np.radians(lat))
        along, east, north = errors[0], *(np.radians(errors[1:]) * amplitude)
        steps = np.stack([along * r, east * np.cos(np.radians(lat)) * p, north * q])
        return cls(amplitude * r, steps.T @ steps, frame, unit)

    @property
    def sigma(self):
        """Standard error of each component, (3,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def amplitude(self):
        """Length of the vector as estimated; noise makes it too long on average."""
        return float(np.linalg.norm(self.value))

    @property
    def amplitude_error(self):
        """Standard error of the length, to first order (nan for a null vector)."""
        along = self._unit_vector()
        return float(np.sqrt(along @ self.covariance @ along))

    @property
    def debiased_amplitude(self):
        """√(|v|² − tr C), or 0 where the noise accounts for all of the length."""
        return float(np.sqrt(max(0.0, self.value @ self.value - np.trace(self.covariance))))

    @property
    def direction(self):
        """Longitude in [0, 360) and latitude, a pair. [deg]"""
        return tuple(float(np.degrees(angle)) for angle in angles(self.value))

    @property
    def direction_error(self):
        """Standard errors of longitude (not times cos) and latitude, to first order. [deg]"""
        lon, lat = np.radians(self.direction)
        p, q, _ = triad(lon, lat)
        with np.errstate(divide="ignore", invalid="ignore"):
            east = np.sqrt(p @ self.covariance @ p) / (self.amplitude * np.cos(lat))
            north = np.sqrt(q @ self.covariance @ q) / self.amplitude
        return float(np.degrees(east)), float(np.degrees(north))

    def to_frame(self, name):
        """The same vector along the axes of another frame."""
        matrix = rotation_matrix(self.frame, name)
        return replace(self, value=matrix @ self.value, covariance=matrix @ self.covariance @ matrix.T, frame=name)

    def _unit_vector(self):
        with np.errstate(invalid="ignore"):
            return self.value / np.linalg.norm(self.value)
