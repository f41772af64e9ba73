"""A vector with its covariance: a spin, an acceleration, an orientation or a velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, fdtrc, log_ndtr

from vsh.length import FEWEST_DOF, length_interval, length_limits, standard_errors
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import between, covariance, float_array, number
from vsh.tools.digits import format_values, format_with_error
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Equal, Frozen
from vsh.tools.types import FloatArray, Quantity

#: The p-value of three standard deviations: what is less likely by chance is called seen.
SEEN = 0.0027


def as_quantity(values: FloatArray, unit: str) -> Quantity:
    """Numbers as astropy's Quantity; the unit may have µ, and two strokes, which astropy warns of."""
    from astropy.units import Quantity

    return Quantity(values, unit.replace("µ", "u").replace("/s/kpc", "/(s kpc)"))


@dataclass(frozen=True, eq=False)
class Vector(Equal, Frozen):
    """A 3-vector along the axes of a frame.

    Attributes
    ----------
    value : (3,) array
        Components x, y, z. [`unit`]
    covariance : (3, 3) array
        Covariance of the components. [the square of `unit`]
    frame : str
        "icrs", "galactic" or "ecliptic".
    unit : str
        "µas/yr" unless said otherwise.
    dof : float
        Degrees of freedom of the covariance, where replicates told it: the p-value is Hotelling's then, and limits
        follow Fisher's F.

    Examples
    --------
    >>> a = Vector([4.3, 0, 0], 0.01 * np.eye(3), frame="galactic").to_frame("icrs")
    >>> a.value.round(3), round(a.amplitude, 3), round(a.amplitude_error, 3)
    (array([-0.236, -3.756, -2.08 ]), 4.3, 0.1)
    >>> "{:.1f}°, {:.1f}°".format(*a.direction)
    '266.4°, -28.9°'
    """

    value: FloatArray
    covariance: FloatArray
    frame: str = "icrs"
    unit: str = "µas/yr"
    dof: float = float("inf")

    def __post_init__(self) -> None:
        check_frame(self.frame)
        # nan stands for components to come, in predictions.
        unit = self.unit.replace("µ", "u")  # as astropy writes it
        value = float_array("the components of a Vector", self.value, (3,), finite=False, unit=unit)
        if np.isinf(value).any():
            raise ParameterError(f"the components of a Vector are finite, not {value}")
        self._set_frozen(value=value, covariance=covariance("the covariance of a Vector", self.covariance, 3))

    def __repr__(self) -> str:
        return f"<Vector: {self.in_numbers()}>"

    def __format__(self, form: str) -> str:
        """Components with their errors, the unit and the frame, numbers in a format such as ".2f"."""
        return self.in_numbers(form) if form else str(self)

    def in_numbers(self, form: str = ".3g") -> str:
        """Components with their errors, the unit and the frame, numbers in the format `form`."""
        values, errors = (", ".join(format(float(x), form) for x in row) for row in (self.value, self.sigma))
        return f"({values}) ± ({errors}) {self.unit}, {self.frame}"

    @classmethod
    def from_spherical(
        cls,
        amplitude: float,
        lon: float,
        lat: float,
        errors: Sequence[float] = (0.0, 0.0, 0.0),
        frame: str = "icrs",
        unit: str = "µas/yr",
    ) -> Vector:
        """A vector of known length and direction.

        Parameters
        ----------
        amplitude : float
            [`unit`]
        lon, lat : float
            [deg]
        errors : (3,) array
            Standard errors of these three, uncorrelated; that of the longitude not times cos(lat).
        frame : str
            "icrs", "galactic" or "ecliptic".
        unit : str
            Unit of the amplitude.

        Examples
        --------
        >>> Vector.from_spherical(4.3, 0, 0, frame="galactic").value
        array([4.3, 0. , 0. ])
        """
        amplitude, lon, lat = number("amplitude", amplitude), number("lon", lon), number("lat", lat)
        sigma = float_array("errors", errors, (3,))
        p, q, r = triad(np.radians(lon), np.radians(lat))
        radial_error, east_error, north_error = sigma[0], *(np.radians(sigma[1:]) * amplitude)
        deviations = np.stack([radial_error * r, east_error * np.cos(np.radians(lat)) * p, north_error * q])
        return cls(amplitude * r, deviations.T @ deviations, frame, unit)

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each component, (3,): with the degrees of freedom of the covariance, `dof`, as p_value."""
        return standard_errors(np.diag(self.covariance), self.dof)

    @property
    def quantity(self) -> Quantity:
        """The components as astropy's Quantity, (3,)."""
        return as_quantity(self.value, self.unit)

    def to(self, unit: str) -> Vector:
        """Convert the vector and its covariance to another unit.

        Parameters
        ----------
        unit : str or astropy Unit
            "mas/yr" say.

        Raises
        ------
        ParameterError
            If it is no unit, or of another kind.

        Examples
        --------
        >>> Vector([0, 0, 300], np.eye(3)).to("mas/yr").value
        array([0. , 0. , 0.3])
        """
        from astropy import units

        try:
            target_unit = units.Unit(str(unit).replace("µ", "u"))
            factor = float(units.Unit(self.unit.replace("µ", "u")).to(target_unit))
        except (ValueError, TypeError) as error:
            raise ParameterError(f"a vector in {self.unit} cannot be turned into {unit}: {error}") from None
        label = str(unit) if isinstance(unit, str) else target_unit.to_string().replace(" ", "").replace("uas", "µas")
        return replace(self, value=factor * self.value, covariance=factor**2 * self.covariance, unit=label)

    @property
    def x(self) -> float:
        """The first component. [`unit`]"""
        return float(self.value[0])

    @property
    def y(self) -> float:
        """The second component. [`unit`]"""
        return float(self.value[1])

    @property
    def z(self) -> float:
        """The third component. [`unit`]"""
        return float(self.value[2])

    @property
    def ra(self) -> float:
        """Right ascension of the direction. [deg]"""
        return self.to_frame("icrs").direction[0]

    @property
    def dec(self) -> float:
        """Declination of the direction. [deg]"""
        return self.to_frame("icrs").direction[1]

    def to_skycoord(self) -> Any:
        """The direction as an astropy SkyCoord."""
        from astropy.coordinates import SkyCoord

        return SkyCoord(self.ra, self.dec, unit="deg", frame="icrs")

    @property
    def amplitude(self) -> float:
        """Length of the vector as estimated; noise makes it too long on average."""
        return float(np.linalg.norm(self.value))

    @property
    def amplitude_error(self) -> float:
        """Standard error of the length, to first order (nan for a null vector): good from a signal to noise of 2 on.

        Below it, `amplitude_interval` and `amplitude_limit`.
        """
        with np.errstate(invalid="ignore"):
            unit_vector = self.value / np.linalg.norm(self.value)
        return float(standard_errors(unit_vector @ self.covariance @ unit_vector, self.dof))

    @property
    def debiased_amplitude(self) -> float:
        """√(|v|² − tr C), or 0 where the noise accounts for all of the length."""
        return float(np.sqrt(max(0.0, self.value @ self.value - np.trace(self.covariance))))

    @property
    def p_value(self) -> float:
        """Probability that noise alone gives as long a vector, in units of its errors: χ² with 3 degrees of freedom.

        Hotelling's T² where the covariance has `dof` of its own; nan where there is no error, or few replicates.
        """
        if self.dof < FEWEST_DOF or not np.linalg.det(self.covariance) > 0:
            return float("nan")
        return chance_probability(float(self.value @ np.linalg.solve(self.covariance, self.value)), 3, self.dof)

    def amplitude_interval(self, probability: float = 0.68) -> tuple[float, float]:
        """Compute the lower and upper end of an interval that contains the true length with `probability`.

        The coverage is close to `probability` at any signal to noise, including zero, and for any covariance. For
        error ratios of 1 : 1 : 1 to 1 : 1 : 8 and a signal along the best or worst axis, 68 % intervals have 63 to 74 %
        coverage (docs/validation.md). Intervals from `amplitude_error` have 19 % coverage without a signal.

        Notes
        -----
        The interval is that of Feldman & Cousins (1998), with the direction profiled (`vsh.length`). It begins at zero
        if and only if `p_value` is larger than 1 − `probability`.
        """
        probability = between("probability", probability, 0, 1)
        if self.dof < FEWEST_DOF:
            return float("nan"), float("nan")
        if not self._has_errors():
            return self.amplitude, self.amplitude
        return length_interval(self.value, self.covariance, probability, self.dof)

    def amplitude_limit(self, probability: float = 0.95) -> float:
        """Upper limit of the length: a longer vector would have been found longer with `probability`.

        95 % limits have at least 94 % coverage at any signal to noise and for any covariance that is known, and 94 to
        97 % where the vector is longer than three of its largest errors. Below that coverage is higher: a limit that
        excludes no length to which the data are blind cannot have less. Of a covariance that was estimated the same
        holds from 30 degrees of freedom on, and from 3 on where all components have about the same error; where errors
        differ by factors of 3 to 8, coverage falls to 93 % with 10, 91 % with 6 and 86 % with 3 degrees of freedom.
        """
        probability = between("probability", probability, 0, 1)
        if self.dof < FEWEST_DOF:
            return float("nan")
        if not self._has_errors():
            return self.amplitude
        return float(length_limits(self.value[None], self.covariance[None], probability, self.dof)[0])

    def _has_errors(self) -> bool:
        """Return whether components are finite, and their covariance is not zero and rests on enough replicates."""
        return bool(np.isfinite(self.value).all() and self.dof >= FEWEST_DOF and np.trace(self.covariance) > 0)

    def direction_cone(self, probability: float = 0.68) -> float:
        """Opening of the cone about `direction` that holds the true one with `probability`. [deg]

        Covers 61, 69, 73, 73, 70 % (for 68) at a signal to noise of 1, 1.5, 2, 3, 5; below 1 no cone
        has that coverage, and a vector whose `p_value` is above 5 % has no significant direction.

        Notes
        -----
        The posterior of the direction under a prior that is flat in length and in direction.
        """
        probability = between("probability", probability, 0, 1)
        if self.dof < FEWEST_DOF:
            return float("nan")
        if not (max_variance := np.linalg.eigvalsh(self.covariance)[-1]) > 0:
            return 0.0
        # A component that is known exactly is taken as known a thousand times better than the others.
        covariance = float(standard_errors(1.0, self.dof)) ** 2 * (self.covariance + 1e-6 * max_variance * np.eye(3))
        precision = np.linalg.inv(covariance)
        max_angle = min(np.pi, 12 * np.sqrt(np.linalg.eigvalsh(covariance)[-1]) / max(self.amplitude, 1e-300))
        angle = np.linspace(0, max_angle, 400)
        azimuth = (np.arange(72) + 0.5) * 2 * np.pi / 72
        p, q, r = triad(*np.radians(self.direction))
        perpendicular = np.multiply.outer(p, np.cos(azimuth)) + np.multiply.outer(q, np.sin(azimuth))
        n = r[:, None, None] * np.cos(angle)[:, None] + perpendicular[:, None, :] * np.sin(angle)[:, None]
        # ∫ exp(−(rn − v)ᵀ W (rn − v)/2) dr over r > 0.
        a = np.einsum("iab,ij,jab->ab", n, precision, n)
        b = np.einsum("iab,ij,j->ab", n, precision, self.value)
        log_density = b * b / a / 2 - np.log(a) / 2 + log_ndtr(b / np.sqrt(a))
        density = np.exp(log_density - log_density.max()).sum(1) * np.sin(angle)
        cumulative = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
        return float(np.degrees(np.interp(probability, cumulative / cumulative[-1], angle)))

    @property
    def direction(self) -> tuple[float, float]:
        """Longitude in [0, 360) and latitude, a pair. [deg]"""
        lon, lat = angles(self.value)
        return float(np.degrees(lon)), float(np.degrees(lat))

    @property
    def direction_error(self) -> tuple[float, float]:
        """Standard errors of longitude (not times cos) and latitude, to first order. [deg]

        Good where they are small; `direction_cone` otherwise, and near a pole.
        """
        lon, lat = np.radians(self.direction)
        p, q, _ = triad(lon, lat)
        with np.errstate(divide="ignore", invalid="ignore"):
            east, north = standard_errors([axis @ self.covariance @ axis for axis in (p, q)], self.dof) / self.amplitude
            east /= np.cos(lat)
        return float(np.degrees(east)), float(np.degrees(north))

    def to_frame(self, name: str) -> Vector:
        """Turn the vector to the axes of the frame `name`: icrs, galactic or ecliptic."""
        matrix = rotation_matrix(self.frame, name)
        return replace(self, value=matrix @ self.value, covariance=matrix @ self.covariance @ matrix.T, frame=name)

    def _facts(self):
        """Length and direction, for a notebook."""
        lon, lat = self.direction
        amplitude = f"{format_with_error(self.amplitude, self.amplitude_error)} {self.unit}"
        components = ", ".join(format_values(self.value, self.sigma))
        direction = f"{lon:.1f}°, {lat:+.1f}° ({self.frame})"
        return {"value": f"({components}) {self.unit}", "amplitude": amplitude, "direction": direction}


def chance_probability(square: float, n_components: int, dof: float = float("inf")) -> float:
    """Probability of as large a vᵀ C⁻¹ v by chance: of χ², or of Hotelling's T² where C has degrees of freedom."""
    if np.isinf(dof):
        return float(chdtrc(n_components, square))
    denominator_dof = dof - n_components + 1
    if denominator_dof <= 0:
        return float("nan")
    return float(fdtrc(n_components, denominator_dof, square * denominator_dof / (n_components * dof)))


def correlation_of(covariance: FloatArray) -> FloatArray:
    """The correlation matrix of a covariance."""
    sigma = np.sqrt(np.diag(covariance))
    return covariance / np.outer(sigma, sigma)


#: Acceleration of the Solar System as Gaia EDR3 has it, towards the Galactic centre (Klioner et al. 2021, A&A 649, A9).
GAIA_EDR3 = Vector.from_spherical(5.05, 269.1, -31.6, (0.35, 5.4, 4.1))
