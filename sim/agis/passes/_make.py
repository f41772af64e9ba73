"""Passes by whichever way there is: compiled, or by a sparse matrix."""

from typing import Any, Protocol

import numpy as np
from scipy import sparse

from sim.agis.passes._scans import BANDS, Scans, values
from vsh.tools.errors import ParameterError
from vsh.tools.types import BoolArray, FloatArray

#: Transits that a design matrix is made for; each takes 400 bytes.
MAX_TRANSITS = 3_000_000
#: From so many on compiled passes are worth the second that it takes to load them.
COMPILED_FROM = 200_000


class SparsePasses:
    """Passes over the observations of some transits."""

    def __init__(self, scans: Any, table: FloatArray) -> None:
        source, knot, frac, sin, cos, fal, fac, spacing, middle = (
            scans.source,
            scans.knot,
            *(
                np.asarray(getattr(scans, name), float)
                for name in ("frac", "sin", "cos", "along_factor", "across_factor")
            ),
            scans.spacing,
            scans.middle,
        )
        table = np.asarray(table, float)
        k, n, self.coefficients = len(source), len(table), scans.intervals + 3
        t = (knot + frac) * spacing - middle
        sa, ca, sd, cd = table[source, :4].T
        q = np.stack([-sd * ca, -sd * sa, cd])
        p = np.stack([-sa, ca, np.zeros(k)])
        m, normal = p * sin + q * cos, -p * cos + q * sin
        rows, columns = np.arange(k), 5 * source[:, None] + np.arange(5)
        of_source = [
            np.stack([s, c, factor, t * s, t * c], axis=1) for s, c, factor in ((sin, cos, fal), (-cos, sin, fac))
        ]
        b, attitude_columns = values(frac), 3 * (knot[:, None, None] + np.arange(4)[:, None]) + np.arange(3)
        of_attitude = [np.einsum("jk,ak->kja", b, axis) for axis in (-normal, m)]

        def matrix(blocks, block_columns, width):
            data = np.concatenate([block.reshape(k, -1) for block in blocks])
            at = np.tile(block_columns.reshape(k, -1), (2, 1))
            row_indices = np.repeat(np.r_[rows, k + rows], at.shape[1])
            return sparse.csr_array((data.ravel(), (row_indices, at.ravel())), shape=(2 * k, width))

        self.sources = matrix(of_source, columns, 5 * n)
        self.attitude = matrix(of_attitude, attitude_columns, 3 * self.coefficients)
        self.weights = np.concatenate([table[source, 4], table[source, 5]])

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        observations = self.weights[:, None] * (self.sources @ x.reshape(-1, x.shape[-1]))
        return (self.attitude.T @ observations).reshape(self.coefficients, 3, -1)

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        observations = self.weights[:, None] * (self.attitude @ h.reshape(-1, h.shape[-1]))
        return (self.sources.T @ observations).reshape(-1, 5, h.shape[-1])

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters."""
        along, across = np.split(self.sources @ x.ravel() + self.attitude @ h.ravel(), 2)
        return along, across

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose, of observations less what parameters make of them."""
        if x is not None and h is not None:
            prediction = self.predict(x, h)
            along, across = along - prediction[0], across - prediction[1]
        observations = self.weights * np.concatenate([along, across])
        return (self.sources.T @ observations).reshape(-1, 5), (self.attitude.T @ observations).reshape(-1, 3)

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""
        weighted_design = self.sources.multiply(self.weights[:, None]).tocsr()
        square = (self.sources.T @ weighted_design).tocoo()
        blocks = np.zeros((self.sources.shape[1] // 5, 5, 5))
        row, column = square.coords
        blocks[row // 5, row % 5, column % 5] = square.data
        normal = (self.attitude.T @ self.attitude.multiply(self.weights[:, None])).tocsr()
        band = np.zeros((BANDS, normal.shape[0]))
        for distance in range(BANDS):
            below = normal.diagonal(-distance)
            band[distance, : len(below)] = below
        return blocks, band


class Passes(Protocol):
    """Passes over the observations of some transits; x are of sources, h of the attitude."""

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x, (coefficients, 3, K)."""
        ...

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h, (n, 5, K)."""
        ...

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters: along and across, (k,) each."""
        ...

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose, of observations less what parameters make of them: (n, 5) and (coefficients, 3)."""
        ...

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """S as (n, 5, 5), and the lower band of A."""


def make_passes(scans: Scans, solved: BoolArray, threads: int | None = None, compiled: bool | None = None) -> Passes:
    """Passes over the transits of the sources that are solved; the others weigh nothing.

    `compiled` is whether they are compiled; None: where numba is installed and they are many.
    """
    table = np.stack([*scans.directions, *(scans.weights * solved).astype(np.float32)], axis=1)
    if compiled or (compiled is None and len(scans) >= COMPILED_FROM):
        try:
            from sim.agis.passes._compiled import CompiledPasses
        except ImportError:
            if compiled or len(scans) > MAX_TRANSITS:
                raise ParameterError(
                    f"{len(scans)} transits are too many without numba: pip install 'vsh-astrometry[agis]'"
                ) from None
        else:
            return CompiledPasses(scans, table, threads)
    return SparsePasses(scans, table)
