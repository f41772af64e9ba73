"""Velocities of galaxies (independent, correlated, flows of linear theory), and fields that change with time.

A velocity is one vector: its tangential part moves a source on the sky, its radial part moves its redshift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sim.signal._signal import ObserverMotion, Signal, TimeDependent, check_nonzero_vector
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, parallax_distance_ratio, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, LinearTheory, VelocityGrid, flow_modes
from vsh.models.waves import unit_vector, wave_motions
from vsh.sky.sphere import local_components, triad
from vsh.tools import arguments
from vsh.tools.arguments import generator, not_negative, number, positive, whole
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, Cosmology, FloatArray, Rng
from vsh.tools.units import AU_PER_YEAR

#: Galaxies whose flows are drawn exactly: 3n × 3n numbers are as many as memory holds.
_MAX_EXACT = 6000
_BLOCK_SIZE = 2048


@dataclass(frozen=True)
class Velocities:
    """Base of signals that are velocities of the sources."""

    cosmology: Cosmology | None
    hubble: float | None

    def velocity(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tangential, (2, n), and radial, (n,), velocities of sources. [km/s]"""
        raise NotImplementedError

    def __call__(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        distance = transverse_distance(redshift, self.cosmology, hubble=self.hubble)
        return self.velocity(lon, lat, distance)[0] / (AU_PER_YEAR * distance)

    def radial(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        """Outward velocities, (n,). [km/s]"""
        return self.velocity(lon, lat, transverse_distance(redshift, self.cosmology, hubble=self.hubble))[1]


@dataclass(frozen=True)
class RandomVelocities(Velocities):
    """Random velocities [km/s], the same sky from the same seed."""

    sigma: float
    seed: int
    length: float | None
    n_waves: int

    def velocity(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tangential and radial velocities, as `Velocities.velocity` says."""
        rng = np.random.default_rng(self.seed)
        if self.length is None:
            return self.sigma * rng.standard_normal((2, len(lon))), self.sigma * rng.standard_normal(len(lon))
        r = triad(lon, lat)[2]
        wave_vectors = rng.standard_normal((self.n_waves, 3)) / self.length
        phases = rng.uniform(0, 2 * np.pi, self.n_waves)
        amplitudes = rng.standard_normal((3, self.n_waves)) * self.sigma * np.sqrt(2 / self.n_waves)
        velocity = np.empty((3, len(lon)))
        for start in range(0, len(lon), 8192):
            block = slice(start, start + 8192)
            velocity[:, block] = amplitudes @ np.cos(wave_vectors @ (r * distance)[:, block] + phases[:, None])
        return local_components(velocity, lon, lat)


@dataclass(frozen=True)
class LinearFlow(Velocities):
    """The flow of linear theory, by modes and what they leave, or exactly."""

    theory: LinearTheory
    seed: int
    n_modes: int
    exact: bool

    def velocity(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tangential and radial velocities, as `Velocities.velocity` says."""
        rng = np.random.default_rng(self.seed)
        scaled_distance = distance * _compute_little_h(self.cosmology, self.hubble)
        if self.exact:
            if len(lon) > _MAX_EXACT:
                raise ParameterError(
                    f"{len(lon)} galaxies are too many to be drawn exactly: {_MAX_EXACT} at most; take exact=False"
                )
            root = _compute_covariance_root(self.theory, lon.tobytes(), lat.tobytes(), scaled_distance.tobytes())
            velocity = (root @ rng.standard_normal(root.shape[0])).reshape(-1, 3).T
            return local_components(velocity, lon, lat)
        # To the same limits whichever sources are asked for: the flow is one field.
        modes = flow_modes(
            0.0, 100.0 * 2 ** np.ceil(np.log2(max(scaled_distance.max(), 50.0) / 100)), self.n_modes, self.theory
        )
        amplitude = rng.standard_normal(len(modes))
        tangential, radial = np.empty((2, len(lon))), np.empty(len(lon))
        for start in range(0, len(lon), _BLOCK_SIZE):
            block = slice(start, start + _BLOCK_SIZE)
            tangential_modes, radial_modes = modes.at(lon[block], lat[block], scaled_distance[block])
            tangential[:, block], radial[block] = tangential_modes @ amplitude, radial_modes @ amplitude
        remaining_sigmas = [np.sqrt(variance) for variance in modes.left(scaled_distance)]
        tangential += remaining_sigmas[0] * rng.standard_normal(tangential.shape)
        return tangential, radial + remaining_sigmas[1] * rng.standard_normal(radial.shape)

    def velocity_here(self, redshift: ArrayLike) -> FloatArray:
        """The flow where we are, along the axes of its frame, (3,), of galaxies at so large a redshift. [km/s]"""
        max_distance = np.max(transverse_distance(redshift, self.cosmology, hubble=self.hubble))
        lon, lat = np.array([0, np.pi / 2, 0, 0]), np.array([0, 0, np.pi / 2, 0])
        return self.velocity(lon, lat, np.array([1e-3, 1e-3, 1e-3, max_distance]))[1][:3]


@dataclass(frozen=True)
class GridFlow(Velocities):
    """Velocities from a grid."""

    grid: VelocityGrid
    frame: str

    def velocity(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tangential and radial velocities, as `Velocities.velocity` says."""
        scaled_distance = distance * _compute_little_h(self.cosmology, self.hubble)
        flow, is_inside = self.grid.at(lon, lat, scaled_distance, self.frame)
        if not is_inside.all():
            raise ParameterError(f"{(~is_inside).sum()} sources lie outside of the grid of velocities, {self.grid!r}")
        return local_components(flow, lon, lat)


@arguments.accepts(rng=arguments.seed, flow=arguments.a(str, LinearTheory, VelocityGrid))
def peculiar(
    sigma: float,
    rng: Rng,
    *,
    length: float | None = None,
    flow: str | LinearTheory | VelocityGrid | None = None,
    exact: bool = False,
    cosmology: Cosmology | None = None,
    hubble: float | None = None,
    n_waves: int = 256,
    n_modes: int = 2000,
    frame: str = "icrs",
) -> Signal:
    """Velocities of the galaxies: random ones, and coherent flows.

    They move sources, and their redshifts too where `sim.observe` is told so.

    Parameters
    ----------
    sigma : float
        Dispersion in each component of what is no flow; may be zero. [km/s]
    rng : Generator or int
        Drawn from once, here: the same signal gives the same sky again.
    length : float, optional
        Velocities r apart are correlated by exp(−r²/(2 length²)); independent unless given [Mpc]
    flow : "linear", LinearTheory or VelocityGrid, optional
        Add the flow of linear theory, with Planck's power spectrum or another; or a given one.
    exact : bool
        Draw the linear flow from the full covariance of all sources, for some thousand of them; else from `n_modes`
        modes, and what they leave independently for each source: with 2000 the covariance errs by half a per cent, and
        that of galaxies less than 15 Mpc/h apart by up to 5 %.
    cosmology, hubble
        As for `secular_parallax`.
    n_waves : int
        Plane waves that make up a correlated field.
    n_modes : int
        Modes that make up a linear flow.
    frame : str
        Axes of the positions, where velocities come from a grid.

    Raises
    ------
    ParameterError
        If the flow is none of these.

    Examples
    --------
    >>> from sim import galaxies, observe
    >>> field = observe(galaxies(50, 1), peculiar(300.0, 2), 3, sigma=1.0)
    >>> len(field)
    50
    """
    length = None if length is None else positive("length", length)
    hubble = None if hubble is None else positive("hubble", hubble)
    seed = int(generator(rng).integers(2**63))
    scatter = RandomVelocities(cosmology, hubble, not_negative("sigma", sigma), seed, length, whole("n_waves", n_waves))
    if flow is None:
        return Signal((scatter,))
    coherent_flow: Velocities
    if isinstance(flow, VelocityGrid):
        coherent_flow = GridFlow(cosmology, hubble, flow, frame)
    else:
        if isinstance(flow, str):
            if flow != "linear":
                raise ParameterError(f'a flow is "linear", a LinearTheory or a VelocityGrid, not {flow!r}')
            flow = LINEAR_PLANCK18
        # A stream of its own: with a flow the random velocities are those without.
        flow_seed = int(np.random.default_rng([seed, 1]).integers(2**63))
        coherent_flow = LinearFlow(cosmology, hubble, flow, flow_seed, whole("n_modes", n_modes), bool(exact))
    return Signal((scatter, coherent_flow) if scatter.sigma else (coherent_flow,))


@lru_cache(maxsize=1)
def _compute_covariance_root(theory, lon_bytes, lat_bytes, distance_bytes):
    """A root of the covariance of velocities; many skies of the same galaxies share it."""
    positions = triad(np.frombuffer(lon_bytes), np.frombuffer(lat_bytes))[2] * np.frombuffer(distance_bytes)
    covariance = theory.covariance(positions)
    covariance[np.diag_indices_from(covariance)] += 1e-9 * theory.sigma**2
    return np.linalg.cholesky(covariance)


def _compute_little_h(cosmology, hubble):
    """H0/100 of the distances: in Mpc/h they are the same whatever it is."""
    return (hubble or hubble_value(FLAT_PLANCK13 if cosmology is None else cosmology)) / 100


@dataclass(frozen=True)
class SecularParallax(ObserverMotion):
    """Parallax by our velocity [km/s, toward the apex]."""

    velocity: FloatArray
    cosmology: Cosmology | None
    hubble: float | None

    def __call__(self, lon: FloatArray, lat: FloatArray, redshift: ArrayLike) -> FloatArray:
        p, q, _ = triad(lon, lat)
        distance = transverse_distance(redshift, self.cosmology, hubble=self.hubble)
        # The curvature acts on distances for the cosmology's own H0.
        factor = parallax_distance_ratio(transverse_distance(redshift, self.cosmology), self.cosmology)
        return -np.stack([self.velocity @ p, self.velocity @ q]) * (factor / (AU_PER_YEAR * distance))


def secular_parallax(velocity: ArrayLike, *, cosmology: Cosmology | None = None, hubble: float | None = None) -> Signal:
    """Parallax by our own motion through the Universe: µ = −v_⊥/d_P, towards the antapex; d_P = d_M in flat space.

    Parameters
    ----------
    velocity : (3,) array
        Ours with respect to the background, towards the apex, along the axes of the frame [km/s]
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.
    hubble : float, optional
        H0 in place of the cosmology's [km/s/Mpc]

    Notes
    -----
    Bachchan, Hobbs & Lindegren (2016), sect. 2.3.

    Examples
    --------
    >>> from sim import galaxies, observe
    >>> field = observe(galaxies(50, 1), secular_parallax((370, 0, 0)), 2, sigma=1.0)
    >>> field.redshift.shape
    (50,)
    """
    hubble = None if hubble is None else positive("hubble", hubble)
    return Signal((SecularParallax(check_nonzero_vector(velocity, "velocity", "km / s"), cosmology, hubble),))


@dataclass(frozen=True)
class SwingingWave(TimeDependent):
    """A plane gravitational wave of a frequency within the mission."""

    direction: FloatArray
    frequency: float
    plus: float
    cross: float
    phase: float

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        oscillation = np.cos(2 * np.pi * self.frequency * time + self.phase)
        return wave_motions(lon, lat, self.direction, self.plus, self.cross) * oscillation


@dataclass(frozen=True)
class TimeFunction(TimeDependent):
    """Any function of position and time."""

    function: Callable[[Any, Any, Any], Any]

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        displacements = np.asarray(self.function(lon, lat, time), float)
        if displacements.shape != (2, len(time)) or not np.isfinite(displacements).all():
            raise ParameterError(f"displacements are (2, {len(time)}) numbers, east, north, not {displacements.shape}")
        return displacements


def wave_in_time(
    direction: ArrayLike, frequency: float, plus: float, cross: float = 0.0, *, phase: float = 0.0
) -> Signal:
    """Make a plane gravitational wave that swings within the mission, for `sim.epochs`.

    Parameters
    ----------
    direction : (3,) array
        Where it travels to, along the axes of the frame; of any length.
    frequency : float
        [1/yr]
    plus, cross : float
        Strains of the two polarisations, as for `plane_wave`; 1 µas is 4.8e-12. [µas]
    phase : float
        At the reference epoch. [rad]

    Notes
    -----
    The exact response at the Earth, of waves much shorter than the distances of the sources; both polarisations in
    phase. Two calls with other phases add.

    Examples
    --------
    >>> wave_in_time((0, 0, 1), 0.5, 2.0).displacement([0.0], [0.0], [0.0]).round(12).ravel()
    array([0., 1.])
    """
    strains = number("plus", plus), number("cross", cross)
    return Signal(
        (SwingingWave(unit_vector(direction), positive("frequency", frequency), *strains, number("phase", phase)),)
    )


def in_time(function: Callable[[Any, Any, Any], Any]) -> Signal:
    """Any displacement of the sky that changes with time, for `sim.epochs`.

    Parameters
    ----------
    function : function of (lon, lat, time)
        From positions [rad] and times since the reference epoch [yr], each (k,), to displacements east and north, (2,
        k). [µas]

    Raises
    ------
    ParameterError
        If it is no function.

    Examples
    --------
    >>> turning = in_time(lambda lon, lat, time: np.stack([10 * np.sin(time) * np.cos(lat), 0 * lat]))
    >>> isinstance(turning, Signal)
    True
    """
    if not callable(function):
        raise ParameterError(f"a displacement is a function of (lon, lat, time), not {function!r}")
    return Signal((TimeFunction(function),))
