"""The tensor of an expansion and the coefficients of degree 2, one from the other."""

import numpy as np

from vsh.coefficients import Coefficients
from vsh.modes import Modes
from vsh.tools.arguments import explained, float_array
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.types import ArrayLike, FloatArray

#: The five coefficients (2,0), (2,1,re), (2,1,im), (2,2,re), (2,2,im) from Σ_zz, Σ_xz, Σ_yz, Σ_xx − Σ_yy, Σ_xy.
_FACTORS = np.sqrt(np.pi / 5) * np.array([np.sqrt(6), -2, 2, 1, -2])
#: Σ_xx, Σ_yy, Σ_zz, Σ_xy, Σ_xz, Σ_yz from the coefficients.
TO_TENSOR = (
    np.array([
        [-0.5, 0, 0, 0.5, 0], [-0.5, 0, 0, -0.5, 0], [1, 0, 0, 0, 0], [0, 0, 0, 0, 1], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0],
    ]) / _FACTORS
)  # fmt: skip
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def coefficients_of(tensor: ArrayLike) -> Coefficients:
    """The coefficients of µ = Σ r − (rᵀ Σ r) r, which is of degree 2 and spheroidal.

    Parameters
    ----------
    tensor : (3, 3) array
        Σ, symmetric; a trace makes no difference. [µas/yr]

    Returns
    -------
    Coefficients
        Coefficients of degree 2.

    Raises
    ------
    ParameterError
        If the tensor is not symmetric.

    Examples
    --------
    >>> bool(np.isclose(coefficients_of(np.diag([-1, -1, 2])).values[11], np.sqrt(6 * np.pi / 5) * 2))
    True
    """
    tensor = float_array("the tensor", tensor, (3, 3))
    if not np.allclose(tensor, tensor.T, rtol=1e-12, atol=1e-12 * np.abs(tensor).max()):
        raise ParameterError("the tensor of an expansion is symmetric")
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor - np.eye(3) * np.trace(tensor) / 3
    values = np.zeros(16)
    values[Modes(2).slice_of("S", 2)] = _FACTORS * np.array([zz, xz, yz, xx - yy, xy])
    return Coefficients(Modes(2), values)


@explained
def tensor_of(coefficients: Coefficients) -> FloatArray:
    """Σ, traceless, of the spheroidal coefficients of degree 2. [µas/yr]

    Parameters
    ----------
    coefficients : Coefficients
        To degree 2 at least.

    Raises
    ------
    ModesError
        If there is no degree 2.
    """
    return matrix_of(TO_TENSOR @ coefficients.values[degree_two(coefficients.modes)])


def degree_two(modes: Modes) -> slice:
    """Where the spheroidal coefficients of degree 2 are stored."""
    if modes.lmax < 2 or modes.components != 2:
        raise ModesError("an expansion that differs from axis to axis is of degree 2: fit motions to degree 2 at least")
    return modes.slice_of("S", 2)


def matrix_of(six: FloatArray) -> FloatArray:
    """A symmetric matrix of its components xx, yy, zz, xy, xz, yz."""
    out = np.empty((3, 3))
    for (i, j), value in zip(PLACES, six, strict=True):
        out[i, j] = out[j, i] = value
    return out
