"""Quantiles over all parts, exactly, in two passes: a fine histogram, then the numbers of the bins that matter."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from vsh.checks.types import ArrayLike, FloatArray, IntArray
from vsh.field import Field
from vsh.parts._parts import Parts

#: Bins: 512 in every factor of two, from 2⁻⁶⁴ to 2⁶⁴. What lies beyond is in the first and the last.
BINS = 2**16
_FINE, _LOWEST = 9, 1023 - 64


def median(sky: Parts, numbers: Callable[[Field], FloatArray], words: str = "median") -> float:
    """The median over all sources, as np.median gives it for all at once."""
    if sky.in_memory is not None:
        return float(np.median(numbers(sky.in_memory)))
    counts = sky.sum(partial(_histogram, numbers=numbers, weights=None), roles=(), words=words)
    n = int(counts.sum())
    middle = [(n + 1) // 2, n // 2 + 1]
    return float(np.mean(_found(sky, numbers, None, counts, middle, (), words)))


def weighted_quantiles(
    sky: Parts,
    numbers: Callable[[Field], FloatArray],
    weights: Callable[[Field], FloatArray],
    shares: ArrayLike,
    *,
    roles: Iterable[str] = (),
    words: str = "quantiles",
) -> FloatArray:
    """For each share, the least number up to which sources hold that share of the weight."""
    counts = sky.sum(partial(_histogram, numbers=numbers, weights=weights), roles=roles, words=words)
    return _found(sky, numbers, weights, counts, np.asarray(shares) * counts.sum(), roles, words)


def _found(sky, numbers, weights, counts, targets, roles, words):
    """The numbers at which the cumulative weight reaches the targets."""
    reached = np.cumsum(counts)
    bins = np.minimum(np.searchsorted(reached, targets), BINS - 1)
    wanted = np.unique(bins)
    gathered = sky.sum(partial(_inside, numbers=numbers, weights=weights, bins=wanted), roles=roles, words=words)
    found = []
    for bin_, target in zip(bins, targets, strict=True):
        values, mass = (np.concatenate(column) for column in zip(*gathered[int(bin_)], strict=True))
        order = np.argsort(values, kind="stable")
        below = reached[bin_] - counts[bin_]
        place = np.searchsorted(below + np.cumsum(mass[order]), target)
        found.append(values[order[min(place, len(order) - 1)]])
    return np.array(found)


def bin_of(numbers: FloatArray) -> IntArray:
    """The bin of each number: a larger one is never in a lower bin, whatever the rounding of logarithms."""
    bits = np.ascontiguousarray(numbers, float).view(np.int64) >> (52 - _FINE)
    return np.clip(bits - (_LOWEST << _FINE), 0, BINS - 1)


def _histogram(field, numbers, weights):
    mass = None if weights is None else weights(field)
    return np.bincount(bin_of(numbers(field)), mass, BINS)


def _inside(field, numbers, weights, bins):
    """Numbers and weights of the sources in some bins, a list for each, which grow by the parts."""
    values = numbers(field)
    mass = np.ones(len(values)) if weights is None else weights(field)
    place = bin_of(values)
    return {int(each): [(values[place == each], mass[place == each])] for each in bins}
