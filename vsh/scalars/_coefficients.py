"""The coefficients of a scalar field, and what is read off their first two degrees."""

from __future__ import annotations

import numpy as np

from vsh.checks.arguments import number
from vsh.checks.arrays import float_array
from vsh.checks.types import ArrayLike, FloatArray
from vsh.coefficients import Coefficients
from vsh.modes import ScalarModes

#: Degree 1 is d·r: rows (1,0), (1,1,re), (1,1,im) of its coefficients from x, y, z of d. That of a glide, over √2.
DIPOLE = np.sqrt(2 * np.pi / 3) * np.array([[0, 0, np.sqrt(2)], [-1, 0, 0], [0, 1, 0]])
DIPOLE.flags.writeable = False


class ScalarCoefficients(Coefficients):
    """A band-limited scalar field on the sphere, f = Σ f_l0 Y_l0 + 2 (f_lm^R Re Y_lm − f_lm^I Im Y_lm).

    Attributes
    ----------
    modes : ScalarModes
        What each entry of `values` multiplies.
    values : (p,) array, read-only
        The coefficients.

    Raises
    ------
    ModesError
        If there are not as many values as modes.

    Notes
    -----
    Norm and signs are those of Mignard & Klioner (2012): a spheroidal mode is the gradient of a scalar one over √(l(l+1)).

    Examples
    --------
    >>> zero_point = ScalarCoefficients.from_moments(mean=-20.0, dipole=(1, 2, 3))
    >>> round(zero_point.mean, 9), zero_point.dipole.round(9)
    (-20.0, array([1., 2., 3.]))
    >>> zero_point.at(lon=[0.0], lat=[0.0]).round(9)
    array([-19.])
    """

    _kind = ScalarModes

    @classmethod
    def from_moments(cls, mean: float = 0.0, dipole: ArrayLike = (0, 0, 0), lmax: int = 1) -> ScalarCoefficients:
        """The field mean + dipole · r.

        Parameters
        ----------
        mean : float
            Of the whole sky.
        dipole : (3,) array
            Along the axes of the frame.
        lmax : int
            The highest degree, at least 1.
        """
        modes = ScalarModes(lmax)
        values = np.zeros(len(modes))
        values[0] = np.sqrt(4 * np.pi) * number("mean", mean)
        values[modes.slice_of("F", 1)] = DIPOLE @ float_array("dipole", dipole, (3,))
        return cls(modes, values)

    @property
    def mean(self) -> float:
        """Of the whole sky, f_00/√4π."""
        return float(self.values[0] / np.sqrt(4 * np.pi))

    @property
    def dipole(self) -> FloatArray:
        """d of the part d·r, along the axes of the frame, (3,)."""
        return np.linalg.solve(DIPOLE, self.values[self.modes.slice_of("F", 1)])

    def at(self, lon: ArrayLike, lat: ArrayLike) -> FloatArray:
        """The field at each position, (n,).

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions [rad]
        """
        return super().at(lon, lat)[0]
