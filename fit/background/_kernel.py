"""The matrix that every marginal likelihood of Gaussian coefficients is made of."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from vsh.checks.types import FloatArray
from vsh.errors import DegeneracyError


def parts_of(matrix: FloatArray, rhs: FloatArray, variances: FloatArray) -> tuple[float, float]:
    """ln|K| and Q of coefficients with variances D, for errors of scale one."""
    root, k = kernel(matrix, variances)
    side = root * rhs
    factor, solved, failed = dposv(k, side, lower=1, overwrite_a=1)
    if failed:  # cannot be: K is the identity and more
        raise DegeneracyError("the normal matrix is not positive: it is no sum over sources")
    return 2 * float(np.log(factor.diagonal()).sum()), float(side @ solved)


def kernel(matrix: FloatArray, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """√D, and K = I + D^½ N D^½ in the order that LAPACK overwrites."""
    root = np.sqrt(variances)
    k = np.multiply(matrix, root[:, None] * root, order="F")
    k.ravel("K")[:: len(k) + 1] += 1
    return root, k
