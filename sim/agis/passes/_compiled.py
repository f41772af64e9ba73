"""Passes over the observations by the compiled kernels, in parts that threads share."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from sim.agis.passes import _kernels
from sim.agis.passes._scans import BANDS, PARTS
from vsh.tools.parallel import cores
from vsh.tools.types import FloatArray


class CompiledPasses:
    """Passes over the observations; sums of parts are added in their order, so that threads change no bit."""

    def __init__(self, scans: Any, table: FloatArray, threads: int | None = None) -> None:
        self.coefficients, self.n = scans.intervals + 3, len(table)
        self.threads = min(cores(threads), PARTS)
        # Neighbours on the sky are neighbours in memory: a scan meets few pages then, in less than half the time.
        self.order = _by_place(scans.lon, scans.lat)
        self.rank = np.empty(self.n, np.int32)
        self.rank[self.order] = np.arange(self.n, dtype=np.int32)
        names = ("knot", "frac", "sin", "cos", "along_factor", "across_factor")
        columns = tuple(np.asarray(getattr(scans, name)) for name in names)
        self.transits = (self.rank[scans.source], *columns, table[self.order], scans.spacing, scans.middle)
        # Cut between knots at equal numbers of transits: each part has intervals of its own.
        cuts = np.linspace(0, len(scans) - 1, PARTS + 1).astype(int)[1:-1] if len(scans) else []
        first = np.unique(np.r_[0, scans.knot[cuts], scans.intervals].astype(int))
        self.knots = list(pairwise(first))
        bounds = np.searchsorted(scans.knot, first)
        self.bounds = list(pairwise(bounds.tolist()))

    def _map(self, work: Callable[[int, int, int, int], Any]):
        """work(start, stop, first knot, last knot) of every part, in order."""
        arguments = [(*bounds, *knots) for bounds, knots in zip(self.bounds, self.knots, strict=True)]
        if self.threads == 1:
            return [work(*argument) for argument in arguments]
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(lambda piece: work(*piece), arguments))

    def _joined(self, parts, shape):
        """Sums of parts that overlap by the three coefficients at their ends."""
        out = np.zeros(shape)
        for (first, last), part in zip(self.knots, parts, strict=True):
            out[first : last + 3] += part
        return out

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x."""
        x, lengths = x[self.order], (0,) * x.shape[-1]

        def work(start, stop, first, last):
            out = np.zeros((last - first + 3, 3, len(lengths)))
            _kernels.to_attitude(start, stop, first, lengths, x, out, self.transits)
            return out

        return self._joined(self._map(work), (self.coefficients, 3, len(lengths)))

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h."""
        h, lengths = np.ascontiguousarray(h), (0,) * h.shape[-1]

        def work(start, stop, first, last):
            out = np.zeros((self.n, 5, len(lengths)))
            _kernels.to_sources(start, stop, lengths, h, out, self.transits)
            return out

        return _sum(self._map(work))[self.rank]

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the parameters make of the observations."""
        along, across = np.empty((2, len(self.transits[0])))
        x, h = x[self.order][..., None], np.ascontiguousarray(h)[..., None]
        self._map(lambda start, stop, first, last: _kernels.predict(start, stop, x, h, along, across, self.transits))
        return along, across

    def adjoint(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose."""
        along, across = np.ascontiguousarray(along), np.ascontiguousarray(across)

        def work(start, stop, first, last):
            sources, attitude = np.zeros((self.n, 5)), np.zeros((last - first + 3, 3, 1))
            _kernels.adjoint(start, stop, first, along, across, sources, attitude, self.transits)
            return sources, attitude

        sources, attitude = zip(*self._map(work), strict=True)
        return _sum(sources)[self.rank], self._joined(attitude, (self.coefficients, 3, 1))[..., 0]

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """Blocks of the sources, (n, 5, 5), and the lower band of the attitude's matrix."""

        def work(start, stop, first, last):
            squares, band = np.zeros((self.n, 5, 5)), np.zeros((3 * (last - first + 3), BANDS))
            _kernels.blocks(start, stop, first, squares, band, self.transits)
            return squares, band

        squares, band = np.zeros((self.n, 5, 5)), np.zeros((3 * self.coefficients, BANDS))
        # Few at a time: these are the largest arrays of all.
        for bounds, (first, last) in zip(self.bounds, self.knots, strict=True):
            more, part = work(*bounds, first, last)
            squares += more
            band[3 * first : 3 * (last + 3)] += part
        above = np.triu_indices(5, 1)
        squares[:, above[0], above[1]] = squares[:, above[1], above[0]]
        return squares[self.rank], band.T


def _by_place(lon, lat):
    """The order of sources in bands of latitude, along each by longitude; some fifty in a square of a band's height."""
    band = np.floor(lat / np.sqrt(4 * np.pi * 50 / len(lat)))
    return np.lexsort((lon, band))


def _sum(parts):
    out = parts[0]
    for part in parts[1:]:
        out += part
    return out
