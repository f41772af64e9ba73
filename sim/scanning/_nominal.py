"""The nominal scanning law, and when it takes the fields of view over a source.

The spin axis z keeps ξ = 45° from the Sun and goes round it 5.8 times a year; the satellite turns about z in six hours;
two fields of view lie 106.5° apart on the great circle at right angles to z. With λ the Sun's longitude and ν the phase
of z about it,

    dν/dλ = [√(S² − cos²ν) + cos ξ sin ν]/sin ξ,   dΩ/dt = ω_z − ν̇ cos ξ − λ̇ sin ξ sin ν

(Lindegren & Bastian 2011, EAS 45, 109; the Gaia scanning law). S follows from 5.8. How the spin axis goes round the Sun
follows from both as integrals over one turn: g(ν) = dν/dλ does not depend on λ, so that λ = ∫ dν/g, and the slow part
of the spin's phase is −cos ξ ∫ dν − sin ξ ∫ sin ν dλ. Both integrands are smooth and periodic in ν; sums over even
steps of ν give their Fourier series, whose terms fall off as a power, to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np

from sim.scanning._crossings import (
    YEAR,
    Cubics,
    Spins,
    compute_sun_direction,
    compute_sun_longitude_rate,
    dot,
    draw_gaps,
    is_outside_gaps,
    sort_gaps,
    sun_position,
)
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import sin_cos, triad
from vsh.tools.arguments import between, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.parallel import has_numba, map_blocks
from vsh.tools.types import ArrayLike, FloatArray, IntArray, Rng
from vsh.tools.units import DEGREE

#: Steps of ν in a turn: at the slowest speed, 1.5, a Fourier term of that order is 1e-53 of the first.
_PHASE_STEPS = 256
_MIN_SPEED = 1.5


class _PeriodicIntegral:
    """∫ f dν of a periodic f, from its values at even steps of ν: a slope, and a Fourier series."""

    def __init__(self, integrand: FloatArray) -> None:
        order = np.arange(1, len(integrand) // 2)
        fourier_terms = np.fft.rfft(integrand)[: len(order) + 1] / len(integrand)
        terms = 2 * fourier_terms[1:] / (1j * order)
        kept_indices = np.flatnonzero(np.abs(terms) > 1e-17 * abs(fourier_terms[0]))
        self.slope, self.terms = fourier_terms[0].real, terms[: kept_indices[-1] + 1 if len(kept_indices) else 0]

    def __call__(self, nu: Any) -> Any:
        wave, series = np.exp(1j * nu), np.zeros(np.shape(nu), complex)
        for term in self.terms[::-1]:
            series = (series + term) * wave
        return self.slope * nu + series.real


class Precession:
    """ν and the slow part of Ω as functions of the Sun's longitude λ (Lindegren & Bastian 2011, EAS 45, 109).

    Parameters
    ----------
    precessions : float
        Turns of the axis about the Sun while the Sun goes round once.
    xi : float
        Angle between the axis and the Sun. [rad]
    """

    def __init__(self, precessions: float, xi: float):
        nu = 2 * np.pi * np.arange(_PHASE_STEPS) / _PHASE_STEPS
        self.xi, self.speed = xi, _MIN_SPEED
        # The mean of 1/g falls with S and is convex: Newton's steps from below do not overshoot.
        for _ in range(100):
            rate = self.rate(nu)
            speed_slope = self.speed / (np.sqrt(self.speed**2 - np.cos(nu) ** 2) * np.sin(xi))
            step = (np.mean(1 / rate) - 1 / precessions) / np.mean(speed_slope / rate**2)
            if step < 0 and self.speed == _MIN_SPEED:
                raise ParameterError(
                    f"precessions must be at least {1 / np.mean(1 / rate):.3g} in a year at this solar_aspect, "
                    f"not {precessions}"
                )
            self.speed += step
            if abs(step) < 1e-15 * self.speed:
                break
        rate = self.rate(nu)
        self._longitude, self._sine = _PeriodicIntegral(1 / rate), _PeriodicIntegral(np.sin(nu) / rate)

    def rate(self, nu: FloatArray) -> FloatArray:
        """g = dν/dλ."""
        return (np.sqrt(self.speed**2 - np.cos(nu) ** 2) + np.cos(self.xi) * np.sin(nu)) / np.sin(self.xi)

    def phase(self, start_phase: float, sun_turn: FloatArray) -> FloatArray:
        """ν [rad] where it was `start_phase`, and the Sun has since turned by `sun_turn`, (n,). [rad]"""
        target_longitude = self._longitude(start_phase) + sun_turn
        nu = target_longitude / self._longitude.slope
        for _ in range(30):
            step = (target_longitude - self._longitude(nu)) * self.rate(nu)
            nu = nu + step
            if not np.any(np.abs(step) > 1e-13 * (1 + np.abs(nu))):
                break
        return nu

    def lag(self, start_phase: float, nu: FloatArray) -> FloatArray:
        """Part of Ω that is missing from an even turn while ν went from `start_phase` to `nu`. [rad]"""
        return -np.cos(self.xi) * (nu - start_phase) - np.sin(self.xi) * (self._sine(nu) - self._sine(start_phase))


@dataclass(frozen=True, eq=False)
class Transits(Frozen):
    """Passages of sources over a field of view, ordered by source and, for each, by time."""

    source: IntArray
    time: FloatArray
    angle: FloatArray
    parallax_factor: FloatArray
    view: IntArray
    across: FloatArray

    def __len__(self) -> int:
        return len(self.source)

    def counts(self, n: int) -> IntArray:
        """Number per source, (n,)."""
        return np.bincount(self.source, minlength=n)


T = TypeVar("T")
#: Longer missions are typing errors, and in a shorter one Gaia does not turn ten times.
MAX_YEARS, MIN_YEARS = 100, 0.01
#: Sources looked at together; each with every spin of the mission.
BLOCK = 1000
#: By how much the axis may leave a straight line within a spin before transits are looked for again. [rad]
_MAX_BEND = 60 / 3600 * DEGREE
#: From so many sources on crossings are looked for by a compiled loop, which takes a second to load.
_COMPILED_FROM = 20_000


@dataclass(frozen=True, eq=False)
class NominalScanningLaw(Frozen):
    """The nominal scanning law of Gaia.

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
        if self.years < MIN_YEARS:
            raise ParameterError(f"years, the length of a mission, must be at least {MIN_YEARS}, not {self.years}")
        for name in ("start", "precession_phase", "spin_phase", "pole_days"):
            number(name, getattr(self, name))
        for name in ("precessions", "spin_rate", "half_height"):
            positive(name, getattr(self, name))
        between("solar_aspect", self.solar_aspect, 0, np.pi / 2)
        between("basic_angle", self.basic_angle, 0, np.pi)
        if not 0 <= number("dead_time", self.dead_time) < 1:
            raise ParameterError(f"dead_time is a fraction, at least 0 and below 1, not {self.dead_time}")
        check_frame(self.frame)
        gaps = sort_gaps(self.gaps)
        random_gaps = draw_gaps(self.years, self.dead_time, self.rng) if self.dead_time else gaps[:0]
        self._state["gaps"] = sort_gaps(np.concatenate([gaps, random_gaps]))
        self._integrate_law()

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
        return compute_sun_direction(self.start, time)

    def attitude(self, time: FloatArray) -> Any:
        """Spin axis and both fields of view at `time` [yr since the start], (n,): z, preceding, following."""
        time = np.asarray(time, float)
        (z, u, w), _ = self._compute_axes_and_sun(time)
        phase = self._compute_spin_phase(time)
        views = [u * np.cos(phase + a) + w * np.sin(phase + a) for a in (self.basic_angle / 2, -self.basic_angle / 2)]
        rotation = rotation_matrix("ecliptic", self.frame)
        return tuple(rotation @ v for v in (z, *views))

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
        blocks = self.map_transits(
            lambda chunk, transits: replace(transits, source=transits.source + chunk.start), lon, lat, threads, progress
        ) or [self.transits_of_block(lon, lat)]
        names = [entry.name for entry in fields(Transits)]
        return Transits(*(np.concatenate([getattr(transits, name) for transits in blocks]) for name in names))

    def map_transits(
        self, function: Callable[..., T], lon: FloatArray, lat: FloatArray, threads: int | None, progress: bool
    ) -> list[T]:
        """`function` of blocks of `lon`, `lat` and their transits, in order, by `threads`; `progress` shows a bar."""
        is_compiled = len(lon) >= _COMPILED_FROM and has_numba()

        def apply_to_block(chunk):
            return function(chunk, self.transits_of_block(lon[chunk], lat[chunk], compiled=is_compiled))

        return list(map_blocks(apply_to_block, len(lon), BLOCK, threads, "transits" if progress else None))

    def transits_of_block(self, lon: ArrayLike, lat: ArrayLike, *, compiled: bool = False) -> Transits:
        """Find transits in one thread, for few enough `lon`, `lat` [rad] that each may meet every spin at once.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions in `frame`. [rad]
        compiled : bool
            Look for crossings by numba, which must be installed; times agree to rounding.
        """
        p, q, r = (rotation_matrix(self.frame, "ecliptic") @ v for v in triad(lon, lat))
        spins: Spins = self._state["spins"]
        max_sine = np.sin(self.half_height)
        # Between spins the height is taken as linear, good to 20 arcsec; hence a margin, and a second look.
        max_height = max_sine * 1.03 if spins.bend < _MAX_BEND else max_sine + 1.5 * spins.bend
        source, time, views = spins.find_crossings(r, max_height, self.basic_angle / 2, compiled=compiled)
        if spins.bend >= _MAX_BEND:
            time = self._refine_crossing_times(r[:, source], time, views)
        is_observed = is_outside_gaps(time, self._state["gaps"])
        source, time, views = source[is_observed], time[is_observed], views[is_observed]
        (z, _, _), (sun, distance) = self._compute_axes_and_sun(time)
        directions = r[:, source]
        sine = dot(directions, z)
        hits = np.abs(sine) < max_sine
        if not hits.all():
            source, time, views, sine, distance = source[hits], time[hits], views[hits], sine[hits], distance[hits]
            z, sun, directions = z[:, hits], sun[:, hits], directions[:, hits]
        # The scan goes along s = z × r/cos ζ: s·p = z·q/cos ζ, s·q = −z·p/cos ζ.
        angle = np.arctan2(dot(z, q[:, source]), -dot(z, p[:, source]))
        sun_along_scan = sun[0] * (z[1] * directions[2] - z[2] * directions[1]) + sun[1] * (
            z[2] * directions[0] - z[0] * directions[2]
        )
        # Gaia is opposite the Sun, 1 % farther out than the Earth; a parallax shifts towards the Sun.
        parallax_factor = 1.01 * distance * sun_along_scan / np.sqrt(1 - sine * sine)
        return Transits(source, time, angle, parallax_factor, views, np.arcsin(sine))

    def _integrate_law(self):
        """ν and Ω as cubics of time, and the axes at the start of every spin."""
        precession = Precession(self.precessions, self.solar_aspect)
        speed = precession.speed
        spin_rate = self.spin_rate / 3600 * DEGREE * 86400 * YEAR  # rad a year
        pole_years = self.pole_days / YEAR
        start_phase = np.pi * round(self.precession_phase / np.pi) if pole_years else self.precession_phase

        grid_times = np.linspace(0, self.years, max(2, int(self.years * YEAR * 2)) + 1)
        sun_longitude, _ = sun_position(self.start, np.maximum(np.append(pole_years, grid_times), pole_years))
        phase = precession.phase(start_phase, sun_longitude[1:] - sun_longitude[0])
        sun_speed = np.where(grid_times < pole_years, 0.0, compute_sun_longitude_rate(self.start, grid_times))
        phase_rate = precession.rate(phase) * sun_speed
        lag_rate = -np.cos(self.solar_aspect) * phase_rate - np.sin(self.solar_aspect) * np.sin(phase) * sun_speed
        nu = Cubics(grid_times[1], phase, phase_rate)
        slow = Cubics(grid_times[1], precession.lag(start_phase, phase), lag_rate)

        self._state.update(speed=speed, nu=nu, rate=spin_rate, slow=slow)
        last_spin = int(np.floor(self._compute_spin_phase(self.years) / (2 * np.pi)))
        first_spin = int(np.ceil(self._compute_spin_phase(0.0) / (2 * np.pi)))
        turn_phases = 2 * np.pi * np.arange(first_spin, last_spin + 1)
        times: Any = (turn_phases - self.spin_phase) / spin_rate
        for _ in range(4):  # Newton: Ω grows 1600 times as fast as its slow part
            times -= (self._compute_spin_phase(times) - turn_phases) / (spin_rate + slow.slope(times))
        self._state["spins"] = Spins(times, *self._compute_axes_and_sun(times)[0])

    def _refine_crossing_times(self, directions, time, views):
        """Times at which the fields really pass, by Newton steps: in a long spin its axis does not move straight."""
        end_time = np.nextafter(self.years, 0)
        for _ in range(4):
            (_, u, w), _ = self._compute_axes_and_sun(time)
            azimuth = np.arctan2(np.sum(directions * w, 0), np.sum(directions * u, 0))
            phase_error = azimuth - self._compute_spin_phase(time) - views * self.basic_angle / 2
            time = np.clip(time + ((phase_error + np.pi) % (2 * np.pi) - np.pi) / self._state["rate"], 0, end_time)
        return time

    def _compute_spin_phase(self, time):
        """Ω, the phase of the spin. [rad]"""
        return self.spin_phase + self._state["rate"] * time + self._state["slow"](time)

    def _compute_axes_and_sun(self, time):
        """z, and u = s × z/sin ξ and w = z × u from which Ω is counted, in the ecliptic; and the Sun, as of `sun`.

        With e ahead of the Sun along the ecliptic and k its pole, z = cos ξ s + sin ξ (cos ν e + sin ν k).
        """
        sun, distance = self.sun(time)
        sin, cos = sin_cos(self._state["nu"](time))
        perpendicular = np.stack([-cos * sun[1], cos * sun[0], sin])  # cos ν e + sin ν k
        u = np.stack([sin * sun[1], -sin * sun[0], cos])
        cos_xi, sin_xi = np.cos(self.solar_aspect), np.sin(self.solar_aspect)
        axes = cos_xi * sun + sin_xi * perpendicular, u, sin_xi * sun - cos_xi * perpendicular
        return axes, (sun, distance)
