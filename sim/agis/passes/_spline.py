"""The attitude's errors: a cubic B-spline in time, of three components along the axes of the sky.

Along the axes of the sky, not of the satellite: so it holds a rotation ε₀ + ω t exactly, whatever its knots.
"""

from __future__ import annotations

import numpy as np

from vsh.checks.types import FloatArray

#: Coefficients that meet in an interval, times three components: rows of the band, the diagonal among them.
BANDS = 12


def values(fraction: FloatArray) -> FloatArray:
    """The four B-splines that are not zero at a fraction of an interval, (4, k).

    Examples
    --------
    >>> values(np.array([0.0])).ravel().round(4)
    array([0.1667, 0.6667, 0.1667, 0.    ])
    """
    f, g = fraction, 1 - fraction
    return np.stack([g**3, 4 - 6 * f**2 + 3 * f**3, 4 - 6 * g**2 + 3 * g**3, f**3]) / 6


def smooth(band: FloatArray, weight: float) -> None:
    """Add to the normal equations a penalty on second differences of the coefficients.

    It bridges gaps in which nothing is observed, costs no bandwidth and spares ε₀ + ω t, which a ridge would not.
    """
    n = band.shape[1] // 3
    difference = (1.0, -2.0, 1.0)
    for first, u in enumerate(difference):
        for second in range(first + 1):
            # Of coefficients k + first and k + second, for k = 0 … n − 3 and three components each.
            band[3 * (first - second), 3 * second : 3 * (second + n - 2)] += weight * u * difference[second]
