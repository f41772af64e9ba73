"""When a mission does not observe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsh.checks.arguments import generator
from vsh.checks.arrays import float_array
from vsh.checks.types import BoolArray, FloatArray, Rng
from vsh.errors import ParameterError

#: Mean length of the lost intervals that are drawn. [yr]
_MEAN = 0.25 / 365.25


def check_gaps(gaps: Sequence[tuple[float, float]] | FloatArray) -> FloatArray:
    """Gaps in the order of time, (k, 2): starts, and ends that do not fall. [yr]"""
    found = float_array("gaps", gaps if len(gaps) else np.empty((0, 2)))
    if found.ndim != 2 or found.shape[1] != 2 or (found[:, 0] >= found[:, 1]).any():
        raise ParameterError(f"gaps are pairs of a start and a later end, in years, not {gaps!r}")
    found = found[np.argsort(found[:, 0], kind="stable")]
    return np.stack([found[:, 0], np.maximum.accumulate(found[:, 1])], axis=1)


def draw_gaps(years: float, dead_time: float, rng: Rng | None) -> FloatArray:
    """Lost intervals, exponential in length about six hours, (k, 2). [yr]"""
    if rng is None:
        raise ParameterError("a dead time needs rng, which draws its gaps")
    rng = generator(rng)
    number = max(1, round(years * dead_time / _MEAN))
    lengths = rng.exponential(_MEAN, number)
    lengths *= years * dead_time / lengths.sum()
    # Free time is cut at random; gaps go into the cuts, so none overlaps another.
    cuts = np.sort(rng.uniform(0, years * (1 - dead_time), number))
    starts = cuts + np.cumsum(lengths) - lengths
    return np.stack([starts, starts + lengths], axis=1)


def alive(time: FloatArray, gaps: FloatArray) -> BoolArray:
    """Which times lie in no gap, (n,)."""
    before = np.searchsorted(gaps[:, 0], time, side="right") - 1
    return (before < 0) | (time >= np.append(gaps[:, 1], 0.0)[before])
