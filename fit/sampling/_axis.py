"""Numbers along which a likelihood is tabulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from vsh.checks.types import FloatArray


@dataclass(frozen=True, eq=False)
class Axis:
    """Chebyshev nodes in asinh(value/scale); a single one where low = high."""

    low: float
    high: float
    scale: float
    count: int

    @property
    def nodes(self) -> FloatArray:
        """Chebyshev nodes between low and high, (k,)."""
        if self.count == 1:
            return np.array([self.low])
        return self._value(np.cos(np.pi * (np.arange(self.count) + 0.5) / self.count))

    def basis(self, value: FloatArray) -> FloatArray:
        """Chebyshev polynomials at values inside the limits, (n, count)."""
        if self.count == 1:
            return np.ones((value.size, 1))
        a, b = self._ends
        return chebyshev.chebvander((2 * np.arcsinh(value / self.scale) - a - b) / (b - a), self.count - 1)

    def to_coefficients(self, table: FloatArray, axis: int) -> FloatArray:
        """From values at the nodes, along one axis of a table, to Chebyshev coefficients."""
        vander = self.basis(self.nodes)
        return np.moveaxis(np.tensordot(np.linalg.inv(vander), table, (1, axis)), 0, axis)

    def finer(self) -> Axis:
        """An axis with more nodes."""
        return Axis(self.low, self.high, self.scale, 2 * self.count if self.count > 1 else 1)

    def at(self, fraction: FloatArray) -> FloatArray:
        """Values at fractions of the way from low to high."""
        return self._value(2 * np.asarray(fraction) - 1) if self.count > 1 else np.full(len(fraction), self.low)

    @property
    def _ends(self):
        return np.arcsinh(self.low / self.scale), np.arcsinh(self.high / self.scale)

    def _value(self, t):
        a, b = self._ends
        return np.clip(self.scale * np.sinh((t * (b - a) + a + b) / 2), self.low, self.high)
