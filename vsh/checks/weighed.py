"""Motions and their errors: weights, χ², sums over both components."""

from __future__ import annotations

import numpy as np

from vsh.checks.frozen import Frozen
from vsh.types import FloatArray


class Weighed(Frozen):
    """What a noun with motions and errors knows of their weights.

    Attributes
    ----------
    motion, sigma : (2, n) arrays
        [µas/yr]
    rho : (n,) array
    """

    motion: FloatArray
    sigma: FloatArray
    rho: FloatArray

    @property
    def weights(self) -> FloatArray:
        """The inverse covariance [[a, c], [c, b]] of each source, (3, n): a, b, c. [(yr/µas)²]"""
        a, b = 1 / self.sigma**2
        c = -self.rho / (self.sigma[0] * self.sigma[1])
        return np.stack([a, b, c]) / (1 - self.rho**2)

    @property
    def whitened(self) -> FloatArray:
        """The motions decorrelated and in units of their errors, L⁻¹ µ with L Lᵀ = C, (2, n)."""
        (s1, s2), rho, (east, north) = self.sigma, self.rho, self.motion
        return np.stack([east / s1, (north / s2 - rho * east / s1) / np.sqrt(1 - rho**2)])

    def inner(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """xᵀ C⁻¹ y of each source, (n,), for two sets of motions (2, n).

        Parameters
        ----------
        x, y : (2, n) arrays
            Motions. [µas/yr]

        Returns
        -------
        array
        """
        a, b, c = self.weights
        return a * x[0] * y[0] + b * x[1] * y[1] + c * (x[0] * y[1] + x[1] * y[0])

    @property
    def chi2(self) -> FloatArray:
        """µᵀ C⁻¹ µ of each source: the χ² of its motion against none, (n,)."""
        return self.inner(self.motion, self.motion)

    @property
    def information(self) -> FloatArray:
        """The trace of each source's inverse covariance, (n,): its weight in sums over both components. [(yr/µas)²]"""
        a, b, _ = self.weights
        return a + b
