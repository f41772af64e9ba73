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
        cuts = np.linspace(0, len(scans) - 1, PARTS + 1).astype(int)[1:-1] if len(scans) else []
        first = np.unique(np.r_[0, scans.knot[cuts], scans.intervals].astype(int))
        self.knots = list(pairwise(first))
        bounds = np.searchsorted(scans.knot, first)
        self.bounds = list(pairwise(bounds.tolist()))

    def _transits(self, part=slice(None)):
        """Arguments of the kernels for some transits, which they count from zero."""
        return (*(column[part] for column in self.columns), self.table, self.spacing, self.middle)

    def _map(self, work: Callable[[int, int, int, int], Any]):
        """work(start, stop, first knot, last knot) of every part, in order; no more are at hand than threads."""
        arguments = [(*bounds, *knots) for bounds, knots in zip(self.bounds, self.knots, strict=True)]
        if self.threads == 1:
            yield from (work(*argument) for argument in arguments)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            for start in range(0, len(arguments), self.threads):
                yield from pool.map(lambda piece: work(*piece), arguments[start : start + self.threads])

    def _join_passes(self, parts, out):
        """Sums of parts that overlap by the three coefficients at their ends."""
        for (first, last), part in zip(self.knots, parts, strict=True):
            out[first : last + 3] += part
        return out

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        x, lengths, transits = x[self.order], (0,) * x.shape[-1], self._transits()

        def work(start, stop, first, last):
            out = np.zeros((last - first + 3, 3, len(lengths)))
            _kernels.to_attitude(start, stop, first, lengths, x, out, transits)
            return out

        return self._join_passes(self._map(work), np.zeros((self.coefficients, 3, len(lengths))))

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        h, lengths, transits = np.ascontiguousarray(h), (0,) * h.shape[-1], self._transits()

        def work(start, stop, first, last):
            out = np.zeros((self.n, 5, len(lengths)))
            _kernels.to_sources(start, stop, lengths, h, out, transits)
            return out

        return _sum(self._map(work))[self.rank]

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by the parameters."""
        along, across = (self.array(len(self.columns[0])) for _ in range(2))
        x, h, transits = x[self.order][..., None], np.ascontiguousarray(h)[..., None], self._transits()
        parts = self._map(lambda start, stop, first, last: _kernels.predict(start, stop, x, h, along, across, transits))
        list(parts)
        return along, across

    def adjoint(
        self, along: FloatArray, across: FloatArray, x: FloatArray | None = None, h: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose, of observations less what parameters make of them."""
        along, across = np.ascontiguousarray(along), np.ascontiguousarray(across)
        given = None if x is None or h is None else (x[self.order][..., None], np.ascontiguousarray(h)[..., None])

        def work(start, stop, first, last):
            sources, attitude = np.zeros((self.n, 5)), np.zeros((last - first + 3, 3, 1))
            for low in range(start, stop, TOGETHER):
                part = slice(low, min(low + TOGETHER, stop))
                seen, k, transits = (along[part], across[part]), part.stop - low, self._transits(part)
                if given is not None:
                    made = np.empty((2, k))
                    _kernels.predict(0, k, *given, *made, transits)
                    seen = tuple(np.subtract(seen, made, out=made))
                _kernels.adjoint(0, k, first, *seen, sources, attitude, transits)
            return sources, attitude

        sources, attitude = np.zeros((self.n, 5)), np.zeros((self.coefficients, 3, 1))
        for (first, last), (part, more) in zip(self.knots, self._map(work), strict=True):
            sources += part
            attitude[first : last + 3] += more
        return sources[self.rank], attitude[..., 0]

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""
        squares, band = np.zeros((self.n, 5, 5)), self.array(3 * self.coefficients, BANDS)
        transits = self._transits()
        # In turn, not side by side: these are the largest arrays of all.
        for (start, stop), (first, last) in zip(self.bounds, self.knots, strict=True):
            part = np.zeros((3 * (last - first + 3), BANDS))
            _kernels.blocks(start, stop, first, squares, part, transits)
            band[3 * first : 3 * (last + 3)] += part
        above = np.triu_indices(5, 1)
        squares[:, above[0], above[1]] = squares[:, above[1], above[0]]
        return squares[self.rank], band.T


def _sum(parts):
    out = None
    for part in parts:
        out = part if out is None else np.add(out, part, out=out)
    return out
