"""Passes over the observations: compiled, in parts that threads share, or by a sparse matrix."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse

from sim.agis.passes._scans import BANDS, BLOCK_TRANSITS, PARTS, Scans, evaluate_splines
from vsh.tools.errors import ParameterError
from vsh.tools.parallel import thread_count
from vsh.tools.types import BoolArray, FloatArray


class CompiledPasses:
    """Passes over the observations; sums of parts are added in their order, so that threads change no bit."""

    def __init__(self, scans: Any, table: FloatArray, threads: int | None = None) -> None:
        from sim.agis.passes import _kernels  # numba takes a second to load

        self._kernels = _kernels
        self.coefficients, self.n = scans.intervals + 3, len(table)
        self.threads = min(thread_count(threads), PARTS)
        self.order, self.array = scans.order, scans.array
        self.rank = np.argsort(self.order)
        names = ("place", "knot", "frac", "sin", "cos", "along_factor", "across_factor")
        self.columns = tuple(np.asarray(getattr(scans, name)) for name in names)
        self.table, self.spacing, self.middle = table[self.order], scans.spacing, scans.middle
        # Cut between knots at equal numbers of transits: each part has intervals of its own.
        cut_rows = np.linspace(0, len(scans) - 1, PARTS + 1).astype(int)[1:-1] if len(scans) else []
        knot_edges = np.unique(np.r_[0, scans.knot[cut_rows], scans.intervals].astype(int))
        self.knots = list(pairwise(knot_edges))
        self.bounds = list(pairwise(np.searchsorted(scans.knot, knot_edges).tolist()))

    def _make_kernel_arguments(self, chunk=slice(None)):
        """Arguments of the kernels for some transits, which they count from zero."""
        return (*(column[chunk] for column in self.columns), self.table, self.spacing, self.middle)

    def _map_parts(self, function: Callable[[int, int, int, int], Any], step: int = 1):
        """work(start, stop, first knot, last knot) of every part, in order; no more are at hand than threads."""
        part_arguments = [(*bounds, *knots) for bounds, knots in zip(self.bounds, self.knots, strict=True)][::step]
        if self.threads == 1:
            yield from (function(*argument) for argument in part_arguments)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            for start in range(0, len(part_arguments), self.threads):
                yield from pool.map(lambda argument: function(*argument), part_arguments[start : start + self.threads])

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        x, lengths, transits = x[self.order], (0,) * x.shape[-1], self._make_kernel_arguments()

        def sum_part(start, stop, first_knot, last_knot):
            attitude_sum = np.zeros((last_knot - first_knot + 3, 3, len(lengths)))
            self._kernels.add_to_attitude(start, stop, first_knot, lengths, x, attitude_sum, transits)
            return attitude_sum

        total = np.zeros((self.coefficients, 3, len(lengths)))
        for (first_knot, last_knot), partial_sum in zip(self.knots, self._map_parts(sum_part), strict=True):
            total[first_knot : last_knot + 3] += partial_sum  # parts overlap by the three coefficients at their ends
        return total

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        h, lengths, transits = np.ascontiguousarray(h), (0,) * h.shape[-1], self._make_kernel_arguments()

        def sum_part(start, stop, first_knot, last_knot):
            source_sum = np.zeros((self.n, 5, len(lengths)))
            self._kernels.add_to_sources(start, stop, lengths, h, source_sum, transits)
            return source_sum

        # From the end, where `to_attitude` stopped: of transits on disk the last are still in memory.
        return reduce(lambda total, term: np.add(total, term, out=total), self._map_parts(sum_part, -1))[self.rank]

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters."""
        along, across = (self.array(len(self.columns[0])) for _ in range(2))
        x, h, transits = x[self.order][..., None], np.ascontiguousarray(h)[..., None], self._make_kernel_arguments()
        list(self._map_parts(lambda start, stop, *_: self._kernels.predict(start, stop, x, h, along, across, transits)))
        return along, across

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Apply the weighted transpose of `predict` to observations less what parameters make of them."""
        along, across = np.ascontiguousarray(along), np.ascontiguousarray(across)
        parameters = None if x is None or h is None else (x[self.order][..., None], np.ascontiguousarray(h)[..., None])

        def sum_part(start, stop, first_knot, last_knot):
            sources, attitude = np.zeros((self.n, 5, 1)), np.zeros((last_knot - first_knot + 3, 3, 1))
            for offset in range(start, stop, BLOCK_TRANSITS):
                chunk = slice(offset, min(offset + BLOCK_TRANSITS, stop))
                observations, k = (along[chunk], across[chunk]), chunk.stop - offset
                transits = self._make_kernel_arguments(chunk)
                if parameters is not None:
                    prediction = np.empty((2, k))
                    self._kernels.predict(0, k, *parameters, *prediction, transits)
                    observations = tuple(np.subtract(observations, prediction, out=prediction))
                self._kernels.add_adjoint(0, k, first_knot, observations, sources, attitude, transits)
            return sources, attitude

        sources, attitude = np.zeros((self.n, 5, 1)), np.zeros((self.coefficients, 3, 1))
        for (first, last), (source_sums, attitude_sums) in zip(self.knots, self._map_parts(sum_part), strict=True):
            sources += source_sums
            attitude[first : last + 3] += attitude_sums
        return sources[self.rank][..., 0], attitude[..., 0]

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""
        source_blocks, band = np.zeros((self.n, 5, 5)), self.array(3 * self.coefficients, BANDS)
        transits = self._make_kernel_arguments()
        # In turn, not side by side: these are the largest arrays of all.
        for (start, stop), (first_knot, last_knot) in zip(self.bounds, self.knots, strict=True):
            band_segment = np.zeros((3 * (last_knot - first_knot + 3), BANDS))
            self._kernels.add_blocks(start, stop, first_knot, source_blocks, band_segment, transits)
            band[3 * first_knot : 3 * (last_knot + 3)] += band_segment
        upper_triangle = np.triu_indices(5, 1)
        source_blocks[:, upper_triangle[0], upper_triangle[1]] = source_blocks[:, upper_triangle[1], upper_triangle[0]]
        return source_blocks[self.rank], band.T


#: Transits that a design matrix is made for; each takes 400 bytes.
MAX_SPARSE_TRANSITS = 3_000_000
#: From so many on compiled passes are worth the second that it takes to load them.
COMPILED_FROM = 200_000


class SparsePasses:
    """Passes over the observations of some transits."""

    def __init__(self, scans: Any, table: FloatArray) -> None:
        source, knot, table = scans.source, scans.knot, np.asarray(table, float)
        names = ("frac", "sin", "cos", "along_factor", "across_factor")
        frac, sin, cos, fal, fac = (np.asarray(getattr(scans, name), float) for name in names)
        k, n, self.coefficients = len(source), len(table), scans.intervals + 3
        t = (knot + frac) * scans.spacing - scans.middle
        sa, ca, sd, cd = table[source, :4].T
        q = np.stack([-sd * ca, -sd * sa, cd])
        p = np.stack([-sa, ca, np.zeros(k)])
        m, perpendicular = p * sin + q * cos, -p * cos + q * sin
        rows, source_columns = np.arange(k), 5 * source[:, None] + np.arange(5)
        source_blocks = [
            np.stack([s, c, factor, t * s, t * c], axis=1) for s, c, factor in ((sin, cos, fal), (-cos, sin, fac))
        ]
        b, attitude_columns = evaluate_splines(frac), 3 * (knot[:, None, None] + np.arange(4)[:, None]) + np.arange(3)
        attitude_blocks = [np.einsum("jk,ak->kja", b, axis) for axis in (-perpendicular, m)]

        def make_sparse_matrix(blocks, block_columns, width):
            entries = np.concatenate([block.reshape(k, -1) for block in blocks])
            column_indices = np.tile(block_columns.reshape(k, -1), (2, 1))
            row_indices = np.repeat(np.r_[rows, k + rows], column_indices.shape[1])
            return sparse.csr_array((entries.ravel(), (row_indices, column_indices.ravel())), shape=(2 * k, width))

        self.sources = make_sparse_matrix(source_blocks, source_columns, 5 * n)
        self.attitude = make_sparse_matrix(attitude_blocks, attitude_columns, 3 * self.coefficients)
        self.weights = np.concatenate([table[source, 4], table[source, 5]])

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        weighted_observations = self.weights[:, None] * (self.sources @ x.reshape(-1, x.shape[-1]))
        return (self.attitude.T @ weighted_observations).reshape(self.coefficients, 3, -1)

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        weighted_observations = self.weights[:, None] * (self.attitude @ h.reshape(-1, h.shape[-1]))
        return (self.sources.T @ weighted_observations).reshape(-1, 5, h.shape[-1])

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters."""
        along, across = np.split(self.sources @ x.ravel() + self.attitude @ h.ravel(), 2)
        return along, across

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Apply the weighted transpose of `predict` to observations less what parameters make of them."""
        if x is not None and h is not None:
            prediction = self.predict(x, h)
            along, across = along - prediction[0], across - prediction[1]
        observations = self.weights * np.concatenate([along, across])
        return (self.sources.T @ observations).reshape(-1, 5), (self.attitude.T @ observations).reshape(-1, 3)

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""
        weighted_design = self.sources.multiply(self.weights[:, None]).tocsr()
        source_normal = (self.sources.T @ weighted_design).tocoo()
        blocks = np.zeros((self.sources.shape[1] // 5, 5, 5))
        row, column = source_normal.coords
        blocks[row // 5, row % 5, column % 5] = source_normal.data
        attitude_normal = (self.attitude.T @ self.attitude.multiply(self.weights[:, None])).tocsr()
        band = np.zeros((BANDS, attitude_normal.shape[0]))
        for offset in range(BANDS):
            diagonal = attitude_normal.diagonal(-offset)
            band[offset, : len(diagonal)] = diagonal
        return blocks, band


#: Passes over the observations of some transits; x are of sources, (n, 5, K), h of the attitude, (coefficients, 3, K).
Passes = CompiledPasses | SparsePasses


def make_passes(scans: Scans, is_solved: BoolArray, threads: int | None = None, compiled: bool | None = None) -> Passes:
    """Passes over the transits of the sources that are solved; the others weigh nothing.

    `compiled` is whether they are compiled; None: where numba is installed and they are many.
    """
    table = np.stack([*scans.sines_and_cosines, *(scans.weights * is_solved).astype(np.float32)], axis=1)
    if compiled or (compiled is None and len(scans) >= COMPILED_FROM):
        try:
            return CompiledPasses(scans, table, threads)
        except ImportError:
            if compiled or len(scans) > MAX_SPARSE_TRANSITS:
                raise ParameterError(
                    f"compiled sums, and more than {MAX_SPARSE_TRANSITS} transits, need numba: pip install "
                    "'vsh-astrometry[agis]'"
                ) from None
    return SparsePasses(scans, table)
