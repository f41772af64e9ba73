"""Times without observations: given, drawn, or read off what was observed."""

from collections.abc import Sequence

import numpy as np

from vsh.tools.arguments import explained, float_array, generator, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, Rng

#: Mean length of the lost intervals that are drawn. [yr]
_MEAN = 0.25 / 365.25


def check_gaps(gaps: Sequence[tuple[float, float]] | FloatArray) -> FloatArray:
    """Gaps in the order of time, (k, 2): starts, and ends that do not fall. [yr]"""
    intervals = float_array("gaps", gaps if len(gaps) else np.empty((0, 2)))
    if intervals.ndim != 2 or intervals.shape[1] != 2 or (intervals[:, 0] >= intervals[:, 1]).any():
        raise ParameterError(f"gaps are pairs of a start and a later end, in years, not {gaps!r}")
    intervals = intervals[np.argsort(intervals[:, 0], kind="stable")]
    return np.stack([intervals[:, 0], np.maximum.accumulate(intervals[:, 1])], axis=1)


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


@explained
def gaps_of(time: ArrayLike, start: float, *, longest: float = 0.003) -> tuple[tuple[float, float], ...]:
    """Gaps of a mission from the times of what was observed, for `NominalScanningLaw(gaps=…)`.

    Parameters
    ----------
    time : (k,) array
        Times of observations of many sources. [Julian years]
    start : float
        Start of the mission, since which gaps are counted. [Julian year]
    longest : float
        A longer time without any observation is a gap; a day is 0.0027. [yr]

    Examples
    --------
    >>> [tuple(round(each, 6) for each in gap) for gap in gaps_of([2015.0, 2015.001, 2015.1], 2015.0)]
    [(0.001, 0.1)]
    """
    times = np.sort(float_array("time", time)) - number("start", start)
    at = np.flatnonzero(np.diff(times) > positive("longest", longest))
    return tuple((float(times[i]), float(times[i + 1])) for i in at)
