"""When fields of view cross sources, by NumPy or by a compiled loop; times without observations; a law from a table."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vsh.sky.frames import check_frame
from vsh.sky.sphere import sin_cos, triad
from vsh.tools.arguments import float_array, generator, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray, Rng
from vsh.tools.units import DEGREE


class Cubics:
    """The cubic polynomials that have given values and slopes at even steps from zero.

    Parameters
    ----------
    step : float
        Between two places.
    values, slopes : (m,) arrays
        At 0, step, 2 step, …
    """

    def __init__(self, step: float, values: FloatArray, slopes: FloatArray) -> None:
        base, rise, ahead = values[:-1], np.diff(values), step * slopes[1:]
        start = step * slopes[:-1]
        self.step, self.powers = step, np.stack([base, start, 3 * rise - 2 * start - ahead, start + ahead - 2 * rise])

    def __call__(self, x: FloatArray) -> FloatArray:
        """Its values at places x, (n,)."""
        (a, b, c, d), fraction = self._find_cubic_and_fraction(x)
        return a + fraction * (b + fraction * (c + fraction * d))

    def slope(self, x: FloatArray) -> FloatArray:
        """Its slopes there."""
        (_, b, c, d), fraction = self._find_cubic_and_fraction(x)
        return (b + fraction * (2 * c + fraction * 3 * d)) / self.step

    def _find_cubic_and_fraction(self, x):
        """Coefficients of the cubic at each place, and how far into its interval that is; the end ones go on beyond."""
        position = np.asarray(x, float) / self.step
        index = np.clip(position.astype(int), 0, self.powers.shape[1] - 1)
        return self.powers[:, index], position - index


YEAR = 365.25  # days
#: Rate of the Sun's mean longitude from the equinox of J2000 (that of date recedes by 50.29″ a year). [deg/day]
_MEAN_RATE = 0.9856474 - 50.29 / 3600 / YEAR


def _compute_mean_sun_angles(start, time):
    days = (start - 2000.0 + time) * YEAR
    return (357.528 + 0.9856003 * days) * DEGREE, (280.460 + _MEAN_RATE * days) * DEGREE


def sun_position(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ecliptic longitude [rad] and distance [AU] of the Sun, equinox J2000, to 0.01° (Astronomical Almanac, C5)."""
    g, mean_longitude = _compute_mean_sun_angles(start, time)
    sin, cos = sin_cos(g)
    # sin 2g = 2 sin g cos g, cos 2g = 2 cos² g − 1
    longitude = mean_longitude + (1.915 + 0.040 * cos) * sin * DEGREE
    return longitude, 1.00028 - (0.01671 + 0.00028 * cos) * cos


def compute_sun_longitude_rate(start: float, time: FloatArray) -> FloatArray:
    """dλ/dt [rad/yr]."""
    g, _ = _compute_mean_sun_angles(start, time)
    anomaly_rate = 0.9856003 * DEGREE * YEAR
    return _MEAN_RATE * DEGREE * YEAR + (1.915 * np.cos(g) + 0.040 * np.cos(2 * g)) * DEGREE * anomaly_rate


def compute_sun_direction(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], so many years after the start."""
    longitude, distance = sun_position(start, np.asarray(time, float))
    sin, cos = sin_cos(longitude)
    return np.stack([cos, sin, np.zeros_like(sin)]), distance


#: Spins that are looked at together: most sources are far from the scan circle in all of them.
CHUNK = 8


class Spins:
    """The axes of a law at the start of every spin.

    Parameters
    ----------
    times : (n,) array
        When spins start. [yr]
    z, u, w : (3, n) arrays
        The spin axis, and the axes that azimuths are counted from and to.
    """

    def __init__(self, times: FloatArray, z: FloatArray, u: FloatArray, w: FloatArray) -> None:
        self.times, self.z, self.u, self.w = times, z, u, w
        #: By how much the axis leaves a straight line within a spin. [rad]
        self.bend = float(np.abs(np.diff(z, 2)).max() / 8) if z.shape[1] > 2 else 0.0
        spin = np.arange(0, max(len(times) - 1, 1), CHUNK)[:, None] + np.arange(CHUNK + 1)
        #: z at the spins of every chunk, the last one filled up, and how far it goes within.
        self.chunks = z[:, np.minimum(spin, len(times) - 1)]
        self.reach = np.sqrt(np.sum((self.chunks - self.chunks[:, :, :1]) ** 2, 0)).max(1)

    def find_crossings(
        self, r: FloatArray, max_height: float, half_angle: float, *, compiled: bool = False
    ) -> tuple[IntArray, FloatArray, IntArray]:
        """Source, time and field (1 preceding, −1 following) of all crossings, ordered by source and time.

        Parameters
        ----------
        r : (3, n) array
            Directions of the sources, in the axes of z.
        max_height : float
            Height above the scan circle, to either side, within which a source is met; between the starts of two spins
            heights are taken as linear.
        half_angle : float
            Half the basic angle. [rad]
        compiled : bool
            By numba, which must be there; otherwise by NumPy.
        """
        if compiled:
            from sim.scanning import _compiled

            r_rows, *axes = (np.ascontiguousarray(vectors.T) for vectors in (r, self.z, self.u, self.w))
            return _compiled.find_crossings(r_rows, tuple(axes), self.times, self.reach, CHUNK, max_height, half_angle)
        source, spin, h0, h1 = self._find_near_sources(r, max_height)
        directions = r[:, source]
        azimuth = np.arctan2(dot(directions, self.w[:, spin]), dot(directions, self.u[:, spin]))
        azimuth_shift = np.arctan2(dot(directions, self.w[:, spin + 1]), dot(directions, self.u[:, spin + 1])) - azimuth
        azimuth_shift -= 2 * np.pi * np.round(azimuth_shift / (2 * np.pi))
        crossings = []
        for view in (1, -1):
            # Where in the spin Ω(f) = 2π f meets the azimuth of the source less that of the field.
            phase = (azimuth - view * half_angle) % (2 * np.pi)
            # Where the azimuth of a source falls, a field may meet it twice in a spin.
            for rows, lap_angle in ((slice(None), 0.0), (np.flatnonzero(phase < -azimuth_shift), 2 * np.pi)):
                fraction = (phase[rows] + lap_angle) / (2 * np.pi - azimuth_shift[rows])
                hit_rows = np.flatnonzero((fraction < 1) & (np.abs(h0[rows] + fraction * (h1 - h0)[rows]) < max_height))
                hit_spins = spin[rows][hit_rows]
                time = self.times[hit_spins] + fraction[hit_rows] * (self.times[hit_spins + 1] - self.times[hit_spins])
                crossings.append((source[rows][hit_rows], time, np.full(len(hit_rows), view)))
        crossing_source, time, views = (np.concatenate(column) for column in zip(*crossings, strict=True))
        # Four lists in order become one.
        order = np.argsort(crossing_source + time / (self.times[-1] + 1), kind="stable")
        return crossing_source[order], time[order], views[order]

    def _find_near_sources(self, r, max_height):
        """Find the sources near the scan circle in which spins, and their heights at the start and the end of each."""
        # Height above the circle at every eighth spin: z moves a degree in one.
        chunk_axes = self.z[:, ::CHUNK][:, : len(self.reach)]
        source, chunk = np.nonzero(np.abs(r.T @ chunk_axes) < max_height + self.reach)
        height = dot(r[:, source, None], self.chunks[:, chunk])
        is_below, is_above = height < max_height, height > -max_height
        row, offset = np.nonzero((is_below[:, :-1] | is_below[:, 1:]) & (is_above[:, :-1] | is_above[:, 1:]))
        spin = chunk[row] * CHUNK + offset
        has_end = spin < self.z.shape[1] - 1
        row, offset = row[has_end], offset[has_end]
        return source[row], spin[has_end], height[row, offset], height[row, offset + 1]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """a · b along the first axis."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


#: Mean length of the lost intervals that are drawn. [yr]
_MEAN_GAP = 0.25 / 365.25


def sort_gaps(gaps: Sequence[tuple[float, float]] | FloatArray) -> FloatArray:
    """Gaps in the order of time, (k, 2): starts, and ends that do not fall. [yr]"""
    intervals = float_array("gaps", gaps if len(gaps) else np.empty((0, 2)))
    if intervals.ndim != 2 or intervals.shape[1] != 2 or (intervals[:, 0] >= intervals[:, 1]).any():
        raise ParameterError(f"gaps are pairs of a start and a later end, in years, not {gaps!r}")
    intervals = intervals[np.argsort(intervals[:, 0], kind="stable")]
    return np.stack([intervals[:, 0], np.maximum.accumulate(intervals[:, 1])], axis=1)


#: Share of a mission without observations that the commands simulate.
DEAD_TIME = 0.06


def draw_gaps(years: float, dead_time: float, rng: Rng | None) -> FloatArray:
    """Lost intervals, exponential in length about six hours, (k, 2). [yr]"""
    if rng is None:
        raise ParameterError("a dead time needs rng, which draws its gaps")
    rng = generator(rng)
    n_gaps = max(1, round(years * dead_time / _MEAN_GAP))
    lengths = rng.exponential(_MEAN_GAP, n_gaps)
    lengths *= years * dead_time / lengths.sum()
    # Free time is cut at random; gaps go into the cuts, so none overlaps another.
    cut_times = np.sort(rng.uniform(0, years * (1 - dead_time), n_gaps))
    starts = cut_times + np.cumsum(lengths) - lengths
    return np.stack([starts, starts + lengths], axis=1)


def is_outside_gaps(time: FloatArray, gaps: FloatArray) -> BoolArray:
    """Mask of the times in no gap, (n,)."""
    gap_index = np.searchsorted(gaps[:, 0], time, side="right") - 1
    return (gap_index < 0) | (time >= np.append(gaps[:, 1], 0.0)[gap_index])


def find_gaps(time: ArrayLike, start: float, *, longest: float = 0.003) -> tuple[tuple[float, float], ...]:
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
    >>> [tuple(round(each, 6) for each in gap) for gap in find_gaps([2015.0, 2015.001, 2015.1], 2015.0)]
    [(0.001, 0.1)]
    """
    times = np.sort(np.ravel(float_array("time", time))) - number("start", start)
    before_gap = np.flatnonzero(np.diff(times) > positive("longest", longest))
    return tuple((float(times[i]), float(times[i + 1])) for i in before_gap)


class TabulatedLaw(InNotebook):
    """A scanning law from a table, as Gaia's `commanded_scan_law` or plans of a mission to come.

    It says where the satellite looks, for `sim.agis.Response`; transits need the `NominalScanningLaw`.

    Parameters
    ----------
    time : (k,) array
        Rising. [Julian years]
    preceding, following : two (2, k) arrays
        Longitude and latitude of the centres of both fields of view. [rad]
    frame : str
        Axes of the positions.
    gap : float
        A longer step between two times is a gap in the observations. [yr]

    Raises
    ------
    ParameterError
        If times do not rise, or the fields are not always as far apart.

    Examples
    --------
    >>> from sim.scanning import NominalScanningLaw
    >>> law = NominalScanningLaw(years=0.02)
    >>> time = np.arange(0, 0.02, 10 / 86400 / 365.25)
    >>> from vsh.sky.sphere import angles
    >>> table = TabulatedLaw(law.start + time, *(angles(view) for view in law.attitude(time)[1:]))
    >>> round(float(np.degrees(table.basic_angle)), 6)
    106.5
    """

    def __init__(
        self, time: ArrayLike, preceding: ArrayLike, following: ArrayLike, *, frame: str = "icrs", gap: float = 0.003
    ) -> None:
        self.frame = check_frame(frame)
        time = float_array("time", time)
        views = [np.asarray(float_array("a field of view", view, (2, len(time)))) for view in (preceding, following)]
        if time.ndim != 1 or len(time) < 2 or (np.diff(time) <= 0).any():
            raise ParameterError("times of a scanning law rise, and are two at least")
        self.start, self.years = float(time[0]), float(time[-1] - time[0])
        preceding_axis, following_axis = (triad(*view)[2] for view in views)
        cosine = np.sum(preceding_axis * following_axis, 0)
        self.basic_angle = float(np.arccos(np.median(cosine)))
        if np.abs(np.arccos(np.clip(cosine, -1, 1)) - self.basic_angle).max() > 0.01 * DEGREE:
            raise ParameterError("the fields of view of a scanning law are always as far apart: look at their units")
        z = np.cross(following_axis, preceding_axis, axis=0)
        self._z = z / np.sqrt(np.sum(z**2, 0))
        middle = preceding_axis + following_axis
        self._middle = middle / np.sqrt(np.sum(middle**2, 0))
        self._times = time - self.start
        self.lost = np.reshape(find_gaps(time, self.start, longest=positive("gap", gap)), (-1, 2))
        rotations = np.arccos(np.clip(np.sum(self._middle[:, 1:] * self._middle[:, :-1], 0), -1, 1))
        if np.median(rotations) > 10 * DEGREE:
            raise ParameterError("the satellite turns by more than 10° from one time to the next: take a finer table")

    def __repr__(self) -> str:
        return f"<TabulatedLaw: {len(self._times)} times, {self.start:.2f} to {self.start + self.years:.2f}>"

    def sun(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], at `time` since the start. [yr]"""
        return compute_sun_direction(self.start, time)

    def attitude(self, time: FloatArray) -> Any:
        """Spin axis and both fields of view at `time` [yr since the start], (n,): z, preceding, following."""
        time = np.clip(np.asarray(time, float), 0, self.years)
        k = np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 2)
        fraction = (time - self._times[k]) / (self._times[k + 1] - self._times[k])
        # Between two times the axis moves straight, and the middle of the fields turns evenly about it.
        z = self._z[:, k] * (1 - fraction) + self._z[:, k + 1] * fraction
        z /= np.sqrt(np.sum(z**2, 0))
        middle_before = self._middle[:, k] - z * np.sum(self._middle[:, k] * z, 0)
        middle_before /= np.sqrt(np.sum(middle_before**2, 0))
        perpendicular = np.cross(z, middle_before, axis=0)
        middle_after = self._middle[:, k + 1]
        angle = fraction * np.arctan2(np.sum(middle_after * perpendicular, 0), np.sum(middle_after * middle_before, 0))
        half = self.basic_angle / 2
        return (z, *(middle_before * np.cos(angle + a) + perpendicular * np.sin(angle + a) for a in (half, -half)))
