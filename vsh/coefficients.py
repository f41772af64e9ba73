"""The coefficients of a vector field, and the physics read off their first degree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsh.basis import harmonics
from vsh.modes import Modes, as_modes
from vsh.tools.arguments import float_array, in_unit
from vsh.tools.errors import ModesError
from vsh.tools.notebook import Frozen
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, FloatArray, Kind, Quantity
from vsh.vector import Vector, as_quantity

#: Degree 1 is a rigid rotation (T) or a glide (S): rows (1,0), (1,1,re), (1,1,im) of its
#: coefficients from x, y, z of the vector (docs/theory.md).
FIRST_DEGREE = np.sqrt(4 * np.pi / 3) * np.array([[0, 0, np.sqrt(2)], [-1, 0, 0], [0, 1, 0]])
FIRST_DEGREE.flags.writeable = False


@dataclass(frozen=True, eq=False)
class Coefficients(Frozen):
    """A band-limited vector field on the sphere.

    Attributes
    ----------
    modes : Modes
        What each entry of `values` multiplies.
    values : (p,) array, read-only
        The coefficients. [µas/yr]

    Raises
    ------
    ModesError
        If there are not as many values as modes.

    Examples
    --------
    >>> spin = Coefficients.from_vectors(rotation=(1, 2, 3))
    >>> np.round(spin.rotation, 12)
    array([1., 2., 3.])
    >>> (spin + spin).power("T", 1) / spin.power("T", 1)
    4.0
    >>> spin.at(lon=np.zeros(5), lat=np.zeros(5)).shape
    (2, 5)
    """

    modes: Modes
    values: FloatArray

    _modes_type = Modes

    def __repr__(self) -> str:
        largest_mode = list(self.modes)[int(np.argmax(np.abs(self.values)))] if len(self.modes) else "none"
        return (
            f"<{type(self).__name__}: {len(self.modes)}, degrees {self.modes.lowest} to {self.modes.lmax}, rms "
            f"{np.sqrt(np.mean(self.values**2)):.3g}, largest {largest_mode}>"
        )

    def to(self, unit: str) -> Quantity:
        """The coefficients as astropy's Quantity, (p,).

        Parameters
        ----------
        unit : str or astropy Unit
            A unit of proper motions, "mas/yr" say.

        Examples
        --------
        >>> Coefficients.from_vectors(rotation=(0, 0, 3)).to("mas/yr").max().round(5)
        <Quantity 0.00868 mas / yr>
        """
        return as_quantity(self.values, "µas/yr").to(str(unit).replace("µ", "u"))

    def __post_init__(self) -> None:
        modes = as_modes(self.modes, self._modes_type)
        # nan stands for coefficients to come, in predictions.
        values = np.array(float_array("the coefficients", self.values, finite=False))
        if np.isinf(values).any():
            raise ModesError(f"{np.isinf(values).sum()} of {values.size} coefficients are infinite")
        if values.shape != (len(modes),):
            raise ModesError(
                f"degree {modes.lmax} has {len(modes)} coefficients; an array of shape {values.shape} was given"
            )
        self._set_frozen(modes=modes, values=values)

    @classmethod
    def from_vectors(cls, rotation: ArrayLike = (0, 0, 0), glide: ArrayLike = (0, 0, 0), lmax: int = 1) -> Coefficients:
        """The rotation ω × r plus the glide g - (g·r) r.

        Parameters
        ----------
        rotation, glide : (3,) arrays
            ω and g, along the axes of the frame. [µas/yr]
        lmax : int
            The highest degree.
        """
        modes = as_modes(lmax)
        values = np.zeros(len(modes))
        values[modes.slice_of("T", 1)] = FIRST_DEGREE @ float_array("rotation", rotation, (3,))
        values[modes.slice_of("S", 1)] = FIRST_DEGREE @ float_array("glide", glide, (3,))
        return cls(modes, values)

    @property
    def rotation(self) -> FloatArray:
        """The spin vector ω along the axes of the frame, (3,). [µas/yr]"""
        return np.linalg.solve(FIRST_DEGREE, self.values[self.modes.slice_of("T", 1)])

    @property
    def glide(self) -> FloatArray:
        """The glide vector g along the axes of the frame, (3,). [µas/yr]"""
        return np.linalg.solve(FIRST_DEGREE, self.values[self.modes.slice_of("S", 1)])

    def vector(
        self, kind: Kind, covariance: FloatArray | None = None, frame: str = "icrs", unit: str = "µas/yr"
    ) -> Vector:
        """Degree 1 as a vector along the axes of a frame: the rotation of T, the glide of S.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        covariance : (p, p) array, optional
            Covariance of the coefficients; they are exact unless given.
        frame : str
            In which the coefficients are.
        unit : str
            Unit of the coefficients.
        """
        degree_one = self.modes.slice_of(kind, 1)
        covariance_block = np.zeros((3, 3)) if covariance is None else np.asarray(covariance)[degree_one, degree_one]
        return solve_degree_one(FIRST_DEGREE, self.values[degree_one], covariance_block, frame, unit)

    def power(self, kind: Kind, l: int) -> float:
        """∫ |V_l|² dΩ of one kind and degree. [(µas/yr)²]

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal; "F" of a scalar field.
        l : int
            The degree.
        """
        degree_values = self.values[self.modes.slice_of(kind, l)]
        return float(degree_values[0] ** 2 + 2 * np.sum(degree_values[1:] ** 2))

    def __call__(self, lon: ArrayLike, lat: ArrayLike) -> FloatArray:
        """The field at places, `at`."""
        return self.at(lon, lat)

    def at(self, lon: ArrayLike, lat: ArrayLike) -> FloatArray:
        """The field at `lon`, `lat` [rad], (…): east and north component, (2, …). [µas/yr]"""
        lon, lat = np.broadcast_arrays(np.asarray(in_unit("lon", lon), float), np.asarray(in_unit("lat", lat), float))
        shape, lon, lat = lon.shape, lon.ravel(), lat.ravel()
        field_values = np.empty((self.modes.components, lon.size))
        block_size = max(1, min(8192, 2**24 // len(self.modes)))  # at most 256 MiB of basis

        def fill_block(block):
            basis = harmonics(lon[block], lat[block], self.modes)
            field_values[:, block] = np.tensordot(self.values, basis, axes=1)

        for _ in map_blocks(fill_block, lon.size, block_size):
            pass
        return field_values.reshape(-1, *shape)

    def to_degree(self, lmax: int) -> Coefficients:
        """Change the highest degree to `lmax`: new modes are zero, those above are cut off."""
        modes = as_modes(lmax, self._modes_type)
        values = np.zeros(len(modes))
        for kind in modes.kinds:
            for l in range(modes.lowest, min(modes.lmax, self.modes.lmax) + 1):
                values[modes.slice_of(kind, l)] = self.values[self.modes.slice_of(kind, l)]
        return type(self)(modes, values)

    def __add__(self, other: Coefficients) -> Coefficients:
        """The sum of two fields; the lower degree is padded."""
        if type(other) is not type(self):
            return NotImplemented
        lmax = max(self.modes.lmax, other.modes.lmax)
        return type(self)(self._modes_type(lmax), self.to_degree(lmax).values + other.to_degree(lmax).values)

    def __mul__(self, factor: float) -> Coefficients:
        """The field times a number."""
        return type(self)(self.modes, self.values * float(factor))

    __rmul__ = __mul__


def solve_degree_one(matrix: FloatArray, values: FloatArray, covariance: FloatArray, frame: str, unit: str) -> Vector:
    """The Cartesian vector that `matrix` turns into the three coefficients of degree 1."""
    # The rows are orthogonal, but not of one length: the inverse, then.
    inverse = np.linalg.inv(matrix)
    return Vector(inverse @ values, inverse @ covariance @ inverse.T, frame, unit)
