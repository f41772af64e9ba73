"""Rotation of coefficients, with their covariance, to another frame.

T and S rotate separately, each like scalar harmonics. The rotation about n by φ acts on degree l
as exp(iφ n·J), with J the matrices of angular momentum. The exponential is computed from
the eigenvectors of n·J, so neither Euler angles nor recurrences are needed.
"""

from typing import Any

import numpy as np
from scipy.linalg import eigh

from vsh.coefficients import Coefficients
from vsh.sky.frames import rotation_matrix
from vsh.tools import arguments
from vsh.tools.arguments import float_array, whole
from vsh.tools.errors import FrameError, ModesError
from vsh.tools.types import ArrayLike, FloatArray

__all__ = ["degree_matrix", "rotate"]


@arguments.accepts(coefficients=arguments.a(Coefficients))
def rotate(coefficients: Coefficients, to: str, *, covariance: ArrayLike | None = None, frame: str = "icrs") -> Any:
    """Rotate a field to the axes of another frame.

    Parameters
    ----------
    coefficients : Coefficients or ScalarCoefficients
        The field. [µas/yr]
    to : str or (3, 3) array
        The new frame: "icrs", "galactic", "ecliptic", or the matrix A of r' = A r.
    covariance : (p, p) array, optional
        Covariance of the coefficients.
    frame : str
        Present frame of the coefficients; not used if `to` is a matrix.

    Raises
    ------
    FrameError
        If a frame is unknown, or the matrix is not a rotation.

    Examples
    --------
    >>> acceleration = rotate(Coefficients.from_vectors(glide=(4.3, 0, 0)), "icrs", frame="galactic")
    >>> acceleration.glide.round(3)
    array([-0.236, -3.756, -2.08 ])
    """
    matrix = rotation_matrix(frame, to) if isinstance(to, str) else _check_rotation_matrix(to)
    from scipy.spatial.transform import Rotation  # imported here: it takes a tenth of the time of a small job

    rotation_vector = Rotation.from_matrix(np.array(matrix)).as_rotvec()
    modes = coefficients.modes
    values = coefficients.values.copy()
    rotated_covariance = None if covariance is None else np.array(covariance, float)
    if rotated_covariance is not None and rotated_covariance.shape != (len(modes), len(modes)):
        raise ModesError(f"the covariance has shape {rotated_covariance.shape}, expected {(len(modes), len(modes))}")
    degree_rotations = [degree_matrix(l, rotation_vector) for l in range(modes.lmax + 1)]
    for (_, l), rows in modes.blocks.items():
        values[rows] = degree_rotations[l] @ values[rows]
        if rotated_covariance is not None:
            rotated_covariance[rows] = degree_rotations[l] @ rotated_covariance[rows]
            rotated_covariance[:, rows] = rotated_covariance[:, rows] @ degree_rotations[l].T
    rotated = type(coefficients)(modes, values)
    return rotated if rotated_covariance is None else (rotated, rotated_covariance)


def degree_matrix(l: int, vector: FloatArray) -> FloatArray:
    """Compute the rotation matrix of the real coefficients (c_0, c_1^R, c_1^I, …) of one degree, (2l + 1, 2l + 1).

    Parameters
    ----------
    vector : (3,) array
        Axis of the rotation r' = A r, times its angle. [rad]
    l : int
        The degree.
    """
    l, (x, y, z) = whole("l", l, 0), float_array("vector", vector, (3,))
    m = np.arange(-l, l + 1)
    raising = np.diag(np.sqrt(l * (l + 1) - m[:-1] * (m[:-1] + 1)), -1)  # J₊ |m⟩ = √… |m + 1⟩
    generator = (x * (raising + raising.T) - 1j * y * (raising - raising.T)) / 2 + np.diag(z * m)
    eigenvalues, eigenvectors = eigh(generator)
    complex_matrix = (eigenvectors * np.exp(-1j * eigenvalues)) @ eigenvectors.conj().T
    # Conversion between real coefficients and those of m = −l … l, where c_{−m} = (−1)^m c_m*.
    to_complex = np.zeros((2 * l + 1, 2 * l + 1), complex)
    to_complex[l, 0] = 1
    for order in range(1, l + 1):
        sign = (-1) ** order
        to_complex[l + order, 2 * order - 1 : 2 * order + 1] = 1, 1j
        to_complex[l - order, 2 * order - 1 : 2 * order + 1] = sign, -1j * sign
    complex_product = complex_matrix @ to_complex
    matrix = np.empty((2 * l + 1, 2 * l + 1))
    matrix[0] = complex_product[l].real
    matrix[1::2], matrix[2::2] = complex_product[l + 1 :].real, complex_product[l + 1 :].imag
    return matrix


def _check_rotation_matrix(matrix):
    try:
        matrix = np.asarray(matrix, float)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-10) or np.linalg.det(matrix) < 0:
        raise FrameError("to= must be the name of a frame or a 3 × 3 rotation matrix")
    return matrix
