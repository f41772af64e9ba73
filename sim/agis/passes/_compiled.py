"""Passes over the observations by the compiled kernels, in parts that threads share."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from sim.agis.passes import _kernels
from sim.agis.passes._scans import BANDS, PARTS, TOGETHER
from vsh.tools.parallel import cores
from vsh.tools.types import FloatArray


class CompiledPasses:
    """Passes over the observations; sums of parts are added in their order, so that threads change no bit."""

    def __init__(self, scans: Any, table: FloatArray, threads: int | None = None) -> None:
        self.coefficients, self.n = scans.intervals + 3, len(table)
        self.threads = min(cores(threads), PARTS)
        self.order, self.array = scans.order, scans.array
        self.rank = np.empty(self.n, np.int32)
        self.rank[self.order] = np.arange(self.n, dtype=np.int32)
        names = ("place", "knot", "frac", "sin", "cos", "along_factor", "across_factor")
        self.columns = tuple(np.asarray(getattr(scans, name)) for name in names)
        self.table, self.spacing, self.middle = table[self.order], scans.spacing, scans.middle
        # Cut between knots at equal numbers of transits: each part has intervals of its own.
        indices = np.linspace(0, len(scans) - 1, PARTS + 1).astype(int)[1:-1] if len(scans) else []
        edges = np.unique(np.r_[0, scans.knot[indices], scans.intervals].astype(int))
        self.knots = list(pairwise(edges))
        bounds = np.searchsorted(scans.knot, edges)
        self.bounds = list(pairwise(bounds.tolist()))

    def _transits(self, chunk=slice(None)):
        """Arguments of the kernels for some transits, which they count from zero."""
        return (*(column[chunk] for column in self.columns), self.table, self.spacing, self.middle)

    def _map(self, work: Callable[[int, int, int, int], Any], step: int = 1):
        """work(start, stop, first knot, last knot) of every part, in order; no more are at hand than threads."""
        arguments = [(*bounds, *knots) for bounds, knots in zip(self.bounds, self.knots, strict=True)][::step]
        if self.threads == 1:
            yield from (work(*argument) for argument in arguments)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            for start in range(0, len(arguments), self.threads):
                yield from pool.map(lambda piece: work(*piece), arguments[start : start + self.threads])

    def _join_passes(self, partial_sums, total):
        """Sums of parts that overlap by the three coefficients at their ends."""
        for (first_knot, last_knot), partial_sum in zip(self.knots, partial_sums, strict=True):
            total[first_knot : last_knot + 3] += partial_sum
        return total

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        x, lengths, transits = x[self.order], (0,) * x.shape[-1], self._transits()

        def work(start, stop, first_knot, last_knot):
            attitude = np.zeros((last_knot - first_knot + 3, 3, len(lengths)))
            _kernels.to_attitude(start, stop, first_knot, lengths, x, attitude, transits)
            return attitude

        return self._join_passes(self._map(work), np.zeros((self.coefficients, 3, len(lengths))))

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        h, lengths, transits = np.ascontiguousarray(h), (0,) * h.shape[-1], self._transits()

        def work(start, stop, first_knot, last_knot):
            sources = np.zeros((self.n, 5, len(lengths)))
            _kernels.to_sources(start, stop, lengths, h, sources, transits)
            return sources

        # From the end, where `to_attitude` stopped: of transits on disk the last are still in memory.
        return _sum(self._map(work, -1))[self.rank]

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters."""
        along, across = (self.array(len(self.columns[0])) for _ in range(2))
        x, h, transits = x[self.order][..., None], np.ascontiguousarray(h)[..., None], self._transits()
        tasks = self._map(
            lambda start, stop, first_knot, last_knot: _kernels.predict(start, stop, x, h, along, across, transits)
        )
        list(tasks)
        return along, across

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose, of observations less what parameters make of them."""
        along, across = np.ascontiguousarray(along), np.ascontiguousarray(across)
        parameters = None if x is None or h is None else (x[self.order][..., None], np.ascontiguousarray(h)[..., None])

        def work(start, stop, first_knot, last_knot):
            sources, attitude = np.zeros((self.n, 5)), np.zeros((last_knot - first_knot + 3, 3, 1))
            for offset in range(start, stop, TOGETHER):
                chunk = slice(offset, min(offset + TOGETHER, stop))
                observations, k, transits = (along[chunk], across[chunk]), chunk.stop - offset, self._transits(chunk)
                if parameters is not None:
                    prediction = np.empty((2, k))
                    _kernels.predict(0, k, *parameters, *prediction, transits)
                    observations = tuple(np.subtract(observations, prediction, out=prediction))
                _kernels.adjoint(0, k, first_knot, *observations, sources, attitude, transits)
            return sources, attitude

        sources, attitude = np.zeros((self.n, 5)), np.zeros((self.coefficients, 3, 1))
        for (first, last), (source_sums, attitude_sums) in zip(self.knots, self._map(work), strict=True):
            sources += source_sums
            attitude[first : last + 3] += attitude_sums
        return sources[self.rank], attitude[..., 0]

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""
        squares, band = np.zeros((self.n, 5, 5)), self.array(3 * self.coefficients, BANDS)
        transits = self._transits()
        # In turn, not side by side: these are the largest arrays of all.
        for (start, stop), (first_knot, last_knot) in zip(self.bounds, self.knots, strict=True):
            segment = np.zeros((3 * (last_knot - first_knot + 3), BANDS))
            _kernels.blocks(start, stop, first_knot, squares, segment, transits)
            band[3 * first_knot : 3 * (last_knot + 3)] += segment
        upper = np.triu_indices(5, 1)
        squares[:, upper[0], upper[1]] = squares[:, upper[1], upper[0]]
        return squares[self.rank], band.T


def _sum(partial_sums):
    total = None
    for partial_sum in partial_sums:
        total = partial_sum if total is None else np.add(total, partial_sum, out=total)
    return total
