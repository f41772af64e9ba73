"""The nominal scanning law, and the Sun it keeps away from.

The nominal scanning law, and when it takes the fields of view over a source.

The spin axis z keeps ξ = 45° from the Sun and goes round it 5.8 times a year; the satellite
turns about z in six hours; two fields of view lie 106.5° apart on the great circle at right
angles to z. With λ the Sun's longitude and ν the phase of z about it,

    dν/dλ = [√(S² − cos²ν) + cos ξ sin ν]/sin ξ,   dΩ/dt = ω_z − ν̇ cos ξ − λ̇ sin ξ sin ν

(Lindegren & Bastian 2011, EAS 45, 109; the Gaia scanning law). S follows from 5.8.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import sin_cos, triad
from vsh.tools.arguments import between, float_array, generator, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen, InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray, Rng
from vsh.tools.units import DEGREE

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


def precession_speed(precessions: float, xi: float) -> float:
    """S for a number of precessions a year: one turn of ν takes 1/K of a turn of λ."""

    from scipy.integrate import quad  # slow to import, and not needed where nothing is scanned
    from scipy.optimize import brentq

    def turn(speed):
        return quad(
            lambda nu: np.sin(xi) / (np.sqrt(speed**2 - np.cos(nu) ** 2) + np.cos(xi) * np.sin(nu)), 0, 2 * np.pi
        )[0]

    return brentq(lambda speed: turn(speed) * precessions - 2 * np.pi, 1.5, 50.0, xtol=1e-12)


YEAR = 365.25  # days
#: Rate of the Sun's mean longitude from the equinox of J2000 (that of date recedes by 50.29″ a year). [deg/day]
_MEAN_RATE = 0.9856474 - 50.29 / 3600 / YEAR


def _anomaly(start, time):
    days = (start - 2000.0 + time) * YEAR
    return (357.528 + 0.9856003 * days) * DEGREE, (280.460 + _MEAN_RATE * days) * DEGREE


def sun_position(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ecliptic longitude [rad] and distance [AU] of the Sun, equinox J2000, to 0.01° (Astronomical Almanac, C5)."""
    g, mean = _anomaly(start, time)
    sin, cos = sin_cos(g)
    # sin 2g = 2 sin g cos g, cos 2g = 2 cos² g − 1
    longitude = mean + (1.915 + 0.040 * cos) * sin * DEGREE
    return longitude, 1.00028 - (0.01671 + 0.00028 * cos) * cos


def sun_rate(start: float, time: FloatArray) -> FloatArray:
    """dλ/dt [rad/yr]."""
    g, _ = _anomaly(start, time)
    turn = 0.9856003 * DEGREE * YEAR
    return _MEAN_RATE * DEGREE * YEAR + (1.915 * np.cos(g) + 0.040 * np.cos(2 * g)) * DEGREE * turn


def sun_direction(start: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], so many years after the start."""
    longitude, distance = sun_position(start, np.asarray(time, float))
    sin, cos = sin_cos(longitude)
    return np.stack([cos, sin, np.zeros_like(sin)]), distance


@dataclass(frozen=True, eq=False)
class Transits(Frozen):
    """Passages of sources over a field of view, ordered by source and, for each, by time."""

    source: IntArray
    time: FloatArray
    angle: FloatArray
    parallax_factor: FloatArray
    view: FloatArray
    across: FloatArray

    def __len__(self) -> int:
        return len(self.source)

    def counts(self, n: int) -> IntArray:
        """How many each of n sources has, (n,)."""
        return np.bincount(self.source, minlength=n)


MAX_YEARS = 100  # longer missions are typing errors
#: Sources looked at together; each with every spin of the mission.
BLOCK = 1000
#: By how much the axis may leave a straight line within a spin before transits are looked for again. [rad]
_BEND = 60 / 3600 * DEGREE


#: Spins that are looked at together: most sources are far from the scan circle in all of them.
_CHUNK = 8


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@dataclass(frozen=True, eq=False)
class NominalScanningLaw(Frozen):
    """Where Gaia looks.

    Parameters
    ----------
    start : float
        Julian year of the start; 2014.73 is that of Gaia's science operations.
    years : float
        Length of the mission.
    precession_phase, spin_phase, solar_aspect : float
        ν and Ω at the start, and ξ. [rad]
    precessions, spin_rate, basic_angle : float
        Turns of the axis about the Sun in a year; speed of the spin [arcsec/s]; angle between the fields of view [rad].
    half_height : float
        Half height of a field, across the scan [rad]; 0.342° gives the published counts with 6 % of dead time.
    pole_days : float
        At first the axis stays in the ecliptic, ν = 0 or π, so that both fields pass the poles every spin. [days]
    dead_time : float
        Fraction of the time that is lost, in gaps of some six hours.
    rng : Generator or int
        Generator of those gaps; needed with a dead time.
    frame : str
        Axes of the positions whose transits are asked for.
    gaps : sequence of (start, end)
        More intervals without observations. [yr]

    Examples
    --------
    >>> z, first, second = NominalScanningLaw(years=1).attitude(np.array([0.5]))
    >>> round(float(np.degrees(np.arccos(first[:, 0] @ second[:, 0]))), 6)
    106.5
    """

    start: float = 2014.73
    years: float = 5.0
    precession_phase: float = 0.0
    spin_phase: float = 0.0
    solar_aspect: float = 45 * DEGREE
    precessions: float = 5.8
    spin_rate: float = 60.0
    basic_angle: float = 106.5 * DEGREE
    half_height: float = 0.342 * DEGREE
    pole_days: float = 0.0
    dead_time: float = 0.0
    rng: Rng | None = None
    frame: str = "icrs"
    gaps: tuple[tuple[float, float], ...] = ()
    remembered: dict = field(default_factory=dict, init=False, repr=False)
    _state: dict = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if positive("years, the length of a mission,", self.years) > MAX_YEARS:
            raise ParameterError(f"years, the length of a mission, must be at most {MAX_YEARS}, not {self.years}")
        for name in ("start", "precession_phase", "spin_phase", "pole_days"):
            number(name, getattr(self, name))
        for name in ("precessions", "spin_rate", "half_height"):
            positive(name, getattr(self, name))
        between("solar_aspect", self.solar_aspect, 0, np.pi / 2)
        between("basic_angle", self.basic_angle, 0, np.pi)
        if not 0 <= number("dead_time", self.dead_time) < 1:
            raise ParameterError(f"dead_time is a fraction, at least 0 and below 1, not {self.dead_time}")
        check_frame(self.frame)
        given = check_gaps(self.gaps)
        drawn = draw_gaps(self.years, self.dead_time, self.rng) if self.dead_time else given[:0]
        self._state["gaps"] = check_gaps(np.concatenate([given, drawn]))
        self._integrate()

    @property
    def speed(self) -> float:
        """S, the speed of the axis among the stars in units of the Sun's."""
        return self._state["speed"]

    @property
    def lost(self) -> FloatArray:
        """Starts and ends of all gaps, (k, 2). [yr]"""
        return self._state["gaps"]

    def sun(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Direction of the Sun in the ecliptic, (3, n), and its distance [AU]; time in years.

        Parameters
        ----------
        time : (k,) array
            Since the start of the mission. [yr]
        """
        return sun_direction(self.start, time)

    def attitude(self, time: FloatArray) -> Any:
        """Spin axis and both fields of view at `time` [yr since the start], (n,): z, preceding, following."""
        time = np.asarray(time, float)
        z, u, w = self._axes(time)
        phase = self._phase(time)
        views = [u * np.cos(phase + a) + w * np.sin(phase + a) for a in (self.basic_angle / 2, -self.basic_angle / 2)]
        back = rotation_matrix("ecliptic", self.frame)
        return tuple(back @ v for v in (z, *views))

    def transits(
        self, lon: ArrayLike, lat: ArrayLike, *, threads: int | None = None, progress: bool = False
    ) -> Transits:
        """All transits of the given positions over the mission.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions in `frame` [rad]
        threads : int, optional
            One a core unless given.
        progress : bool
            Show a bar, after two seconds.
        """
        lon, lat = np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float))
        parts = list(
            map_blocks(
                lambda part: (part.start, self.transits_of_block(lon[part], lat[part])),
                len(lon),
                BLOCK,
                threads,
                "transits" if progress else None,
            )
        )
        names = ("time", "angle", "parallax_factor", "view", "across")
        source = [block.source + start for start, block in parts] or [np.zeros(0, int)]
        return Transits(
            np.concatenate(source),
            *(np.concatenate([getattr(b, name) for _, b in parts] or [np.zeros(0)]) for name in names),
        )

    def transits_of_block(self, lon: ArrayLike, lat: ArrayLike) -> Transits:
        """The same in one thread, for few enough `lon`, `lat` [rad] that each may meet every spin at once."""
        p, q, r = (rotation_matrix(self.frame, "ecliptic") @ v for v in triad(lon, lat))
        u, w, times, bend = (self._state[name] for name in ("u", "w", "times", "bend"))
        limit = np.sin(self.half_height)
        # Between spins the height is taken for linear, good to 20 arcsec; hence a margin, and a second look.
        wide = limit * 1.03 if bend < _BEND else limit + 1.5 * bend
        source, spin, h0, h1 = self._near(r, wide)
        here = r[:, source]
        azimuth = np.arctan2(_dot(here, w[:, spin]), _dot(here, u[:, spin]))
        turn = np.arctan2(_dot(here, w[:, spin + 1]), _dot(here, u[:, spin + 1])) - azimuth
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))

        crossings = []
        for view in (1, -1):
            # Where in the spin Ω(f) = 2π f meets the azimuth of the source less that of the field.
            first = (azimuth - view * self.basic_angle / 2) % (2 * np.pi)
            # Where the azimuth of a source falls, a field may meet it twice in a spin.
            for rows, again in ((slice(None), 0.0), (np.flatnonzero(first < -turn), 2 * np.pi)):
                share = (first[rows] + again) / (2 * np.pi - turn[rows])
                hit = np.flatnonzero((share < 1) & (np.abs(h0[rows] + share * (h1 - h0)[rows]) < wide))
                where = spin[rows][hit]
                time = times[where] + share[hit] * (times[where + 1] - times[where])
                crossings.append((source[rows][hit], time, np.full(len(hit), view)))
        owner, time, views = (np.concatenate(each) for each in zip(*crossings, strict=True))
        # Four lists in order become one.
        order = np.argsort(owner + time / (self.years + 1), kind="stable")
        owner, time, views = owner[order], time[order], views[order]
        if bend >= _BEND:
            time = self._refined(r[:, owner], time, views)
        keep = alive(time, self._state["gaps"])
        owner, time, views = owner[keep], time[keep], views[keep]
        z, sun, distance = self._spin_axis(time)
        here = r[:, owner]
        sine = _dot(here, z)
        keep = np.abs(sine) < limit
        if not keep.all():
            owner, time, views, sine, distance = owner[keep], time[keep], views[keep], sine[keep], distance[keep]
            z, sun, here = z[:, keep], sun[:, keep], here[:, keep]
        # The scan goes along s = z × r/cos ζ: s·p = z·q/cos ζ, s·q = −z·p/cos ζ.
        angle = np.arctan2(_dot(z, q[:, owner]), -_dot(z, p[:, owner]))
        along = sun[0] * (z[1] * here[2] - z[2] * here[1]) + sun[1] * (z[2] * here[0] - z[0] * here[2])
        # Gaia is opposite the Sun, 1 % farther out than the Earth; a parallax shifts towards the Sun.
        factor = 1.01 * distance * along / np.sqrt(1 - sine * sine)
        return Transits(owner, time, angle, factor, views, np.arcsin(sine))

    def _near(self, r, wide):
        """Which sources are near the scan circle in which spins, and their heights at the start and the end of each."""
        z, chunks, reach = (self._state[name] for name in ("z", "chunks", "reach"))
        # Height above the circle at every eighth spin: z moves a degree in one.
        source, chunk = np.nonzero(np.abs(r.T @ z[:, ::_CHUNK][:, : len(reach)]) < wide + reach)
        height = r[0, source, None] * chunks[0, chunk]
        height += r[1, source, None] * chunks[1, chunk]
        height += r[2, source, None] * chunks[2, chunk]
        low, high = height < wide, height > -wide
        row, within = np.nonzero((low[:, :-1] | low[:, 1:]) & (high[:, :-1] | high[:, 1:]))
        spin = chunk[row] * _CHUNK + within
        last = spin < z.shape[1] - 1
        row, within = row[last], within[last]
        return source[row], spin[last], height[row, within], height[row, within + 1]

    def _integrate(self):
        """ν and Ω as splines of time, and the axes at the start of every spin."""
        from scipy.integrate import solve_ivp
        from scipy.interpolate import CubicSpline

        xi = self.solar_aspect
        speed = precession_speed(self.precessions, xi)
        rate = self.spin_rate / 3600 * DEGREE * 86400 * YEAR  # rad a year
        quiet = self.pole_days / YEAR
        start = np.pi * round(self.precession_phase / np.pi) if quiet else self.precession_phase

        def slope(time, state):
            nu = state[0]
            sun = sun_rate(self.start, time)
            nu_rate = (
                0.0
                if time < quiet
                else sun * (np.sqrt(speed**2 - np.cos(nu) ** 2) + np.cos(xi) * np.sin(nu)) / np.sin(xi)
            )
            # What Ω lacks of the turn ω_z t, which is large and exactly known.
            return [nu_rate, -nu_rate * np.cos(xi) - sun * np.sin(xi) * np.sin(nu)]

        grid = np.linspace(0, self.years, max(2, int(self.years * YEAR * 2)) + 1)
        solved = solve_ivp(slope, (0, self.years), [start, 0.0], t_eval=grid, rtol=1e-10, atol=1e-10, max_step=2 / YEAR)
        slow = CubicSpline(grid, solved.y[1])
        nu = CubicSpline(grid, solved.y[0])

        self._state.update(speed=speed, nu=nu, rate=rate, slow=slow)
        spins = int(np.floor(self._phase(self.years) / (2 * np.pi)))
        first = int(np.ceil(self._phase(0.0) / (2 * np.pi)))
        turns = 2 * np.pi * np.arange(first, spins + 1)
        times = (turns - self.spin_phase) / rate
        for _ in range(4):  # Newton: Ω grows 1600 times as fast as its slow part
            times -= (self._phase(times) - turns) / (rate + slow(times, 1))
        z, u, w = self._axes(times)
        bend = np.abs(np.diff(z, 2)).max() / 8 if z.shape[1] > 2 else 0.0
        # z at the spins of every chunk, (3, chunks, 9), and how far it goes within: the last one is filled up.
        spin = np.arange(0, max(len(times) - 1, 1), _CHUNK)[:, None] + np.arange(_CHUNK + 1)
        chunks = z[:, np.minimum(spin, len(times) - 1)]
        reach = np.sqrt(np.sum((chunks - chunks[:, :, :1]) ** 2, 0)).max(1)
        self._state.update(times=times, z=z, u=u, w=w, bend=bend, chunks=chunks, reach=reach)

    def _refined(self, here, time, views):
        """Times at which the fields really pass, by Newton steps: in a long spin its axis does not move straight."""
        last = np.nextafter(self.years, 0)
        for _ in range(4):
            _, u, w = self._axes(time)
            azimuth = np.arctan2(np.sum(here * w, 0), np.sum(here * u, 0))
            late = azimuth - self._phase(time) - views * self.basic_angle / 2
            time = np.clip(time + ((late + np.pi) % (2 * np.pi) - np.pi) / self._state["rate"], 0, last)
        return time

    def _phase(self, time):
        """Ω, the phase of the spin. [rad]"""
        return self.spin_phase + self._state["rate"] * time + self._state["slow"](time)

    def _axes(self, time):
        """z, and u = s × z/sin ξ and w = z × u from which Ω is counted, in the ecliptic."""
        z, sun, _ = self._spin_axis(time)
        u = np.cross(sun, z, axis=0) / np.sin(self.solar_aspect)
        return z, u, np.cross(z, u, axis=0)

    def _spin_axis(self, time):
        """z, the direction of the Sun, and its distance, in the ecliptic."""
        sun, distance = self.sun(time)
        xi, nu = self.solar_aspect, self._state["nu"](time)
        up, ahead = (np.sin(xi) * each for each in sin_cos(nu))
        z = np.stack([np.cos(xi) * sun[0] - ahead * sun[1], np.cos(xi) * sun[1] + ahead * sun[0], up])
        return z, sun, distance


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
        views = [np.asarray(float_array("a field of view", each, (2, len(time)))) for each in (preceding, following)]
        if time.ndim != 1 or len(time) < 2 or (np.diff(time) <= 0).any():
            raise ParameterError("times of a scanning law rise, and are two at least")
        self.start, self.years = float(time[0]), float(time[-1] - time[0])
        first, second = (triad(*each)[2] for each in views)
        cosine = np.sum(first * second, 0)
        self.basic_angle = float(np.arccos(np.median(cosine)))
        if np.abs(np.arccos(np.clip(cosine, -1, 1)) - self.basic_angle).max() > 0.01 * DEGREE:
            raise ParameterError("the fields of view of a scanning law are always as far apart: look at their units")
        z = np.cross(second, first, axis=0)
        self._z = z / np.sqrt(np.sum(z**2, 0))
        middle = first + second
        self._middle = middle / np.sqrt(np.sum(middle**2, 0))
        self._times = time - self.start
        step = np.diff(self._times)
        long = np.flatnonzero(step > positive("gap", gap))
        self.lost = np.stack([self._times[long], self._times[long + 1]], axis=1)
        turned = np.arccos(np.clip(np.sum(self._middle[:, 1:] * self._middle[:, :-1], 0), -1, 1))
        if np.median(turned) > 10 * DEGREE:
            raise ParameterError("the satellite turns by more than 10° from one time to the next: take a finer table")

    def __repr__(self) -> str:
        return f"<TabulatedLaw: {len(self._times)} times, {self.start:.2f} to {self.start + self.years:.2f}>"

    def sun(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], at `time` since the start. [yr]"""
        return sun_direction(self.start, time)

    def attitude(self, time: FloatArray) -> Any:
        """Spin axis and both fields of view at `time` [yr since the start], (n,): z, preceding, following."""
        time = np.clip(np.asarray(time, float), 0, self.years)
        k = np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 2)
        share = (time - self._times[k]) / (self._times[k + 1] - self._times[k])
        # Between two times the axis moves straight, and the middle of the fields turns evenly about it.
        z = self._z[:, k] * (1 - share) + self._z[:, k + 1] * share
        z /= np.sqrt(np.sum(z**2, 0))
        before = self._middle[:, k] - z * np.sum(self._middle[:, k] * z, 0)
        before /= np.sqrt(np.sum(before**2, 0))
        ahead = np.cross(z, before, axis=0)
        after = self._middle[:, k + 1]
        turn = share * np.arctan2(np.sum(after * ahead, 0), np.sum(after * before, 0))
        half = self.basic_angle / 2
        return (z, *(before * np.cos(turn + a) + ahead * np.sin(turn + a) for a in (half, -half)))


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
