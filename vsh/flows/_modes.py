"""Flows as a sum of a few hundred modes with independent amplitudes: harmonics on the sky times functions of distance.

A potential flow of wave number k is

    v_⊥ = √(l(l+1)) j_l(kr)/r S_lm,   v_r = k j_l'(kr) Y_lm,

with amplitudes of variance (2/π) (f H)² P(k)/k² dk: it has no toroidal part. For every degree a singular value
decomposition of these functions of distance, tangential and radial ones together, leaves the few that matter. The
amplitude of a mode is one on average.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.special import spherical_jn

from vsh.basis import scalar_harmonics, spheroidal_twin, toroidal_harmonics
from vsh.checks import arguments
from vsh.checks.frozen import Frozen
from vsh.checks.types import FloatArray
from vsh.errors import ParameterError
from vsh.flows._theory import HUBBLE, PLANCK_2018, LinearTheory

#: Beyond this distance flows move nobody's estimate: sources there have independent velocities. [Mpc/h]
FARTHEST = 600.0
#: Below this distance the modes are as here. [Mpc/h]
_NEAREST = 2.0
_RADII = 160


@dataclass(frozen=True, eq=False, repr=False)
class FlowModes(Frozen):
    """The modes of a flow between two distances, each with an amplitude of one on average.

    Attributes
    ----------
    theory : LinearTheory
    counts : tuple of int
        How many functions of distance there are of each degree from 0 on; degree l has 2l + 1 modes of each.
    radii : (k,) array
        Where the functions are tabulated. [Mpc/h]
    tangential, radial : (k, f) arrays
        The functions, degree by degree. [km/s]
    origin : (f,) array
        The radial ones at distance zero: those of degree 1 alone differ from zero. [km/s]
    """

    theory: LinearTheory
    counts: tuple[int, ...]
    radii: FloatArray
    tangential: FloatArray
    radial: FloatArray
    origin: FloatArray

    def __len__(self) -> int:
        return sum((2 * l + 1) * count for l, count in enumerate(self.counts))

    def __repr__(self) -> str:
        return f"<FlowModes: {len(self)} to degree {len(self.counts) - 1}, {self.radii[0]:.3g} to {self.radii[-1]:.3g} Mpc/h>"

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What every mode adds to the velocities of sources.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        distance : (n,) array
            [Mpc/h]

        Returns
        -------
        tangential : (2, n, p) array
            East and north. [km/s]
        radial : (n, p) array
            Outwards. [km/s]
        """
        distance = np.asarray(distance, float)
        across, along = self._functions(distance)
        return self._combined(np.asarray(lon, float), np.asarray(lat, float), across, along)

    def at_origin(self) -> FloatArray:
        """What every mode adds to the velocity where we are, (3, p), along the axes of the positions. [km/s]"""
        lon, lat = np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, 0.0, np.pi / 2])  # along x, y and z
        here = np.broadcast_to(self.origin, (3, self.origin.size))
        return self._combined(lon, lat, np.zeros_like(here), here)[1]

    def left(self, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The variance of velocities that the modes leave, in each tangential component and in the radial one.

        Parameters
        ----------
        distance : (n,) array
            [Mpc/h]

        Returns
        -------
        tuple[array, array]
            [(km/s)²]
        """
        across, along = self._functions(np.asarray(distance, float))
        l = np.repeat(np.arange(len(self.counts)), self.counts)
        share = (2 * l + 1) / (4 * np.pi)  # Σ_m |S_lm|² = Σ_m |Y_lm|²
        total = self.theory.sigma**2
        return np.maximum(total - across**2 @ share / 2, 0.0), np.maximum(total - along**2 @ share, 0.0)

    def left_at_origin(self) -> float:
        """The same where we are. [(km/s)²]"""
        return float(max(self.theory.sigma**2 - 3 / (4 * np.pi) * np.sum(self.origin**2), 0.0))

    @cached_property
    def _spline(self):
        return make_interp_spline(np.log(self.radii), np.hstack([self.tangential, self.radial]))

    def _functions(self, distance):
        """The functions of distance at sources: two (n, f) arrays; zero beyond the last radius."""
        spline: BSpline = self._spline
        values = spline(np.log(np.clip(distance, self.radii[0], self.radii[-1])))
        values[distance > self.radii[-1] * (1 + 1e-9)] = 0.0
        return np.split(values, 2, axis=1)

    def _combined(self, lon, lat, across, along):
        """Functions of distance times harmonics, normalised to one over the sphere."""
        top = len(self.counts) - 1
        y = scalar_harmonics(lon, lat, top)
        s = spheroidal_twin(toroidal_harmonics(lon, lat, max(top, 1)))
        tangential, radial = np.empty((2, lon.size, len(self))), np.empty((lon.size, len(self)))
        column = first = 0
        for l, count in enumerate(self.counts):
            functions = slice(first, first + count)
            for i in range(2 * l + 1):
                norm = 1.0 if i == 0 else 1 / np.sqrt(2)
                here = slice(column, column + count)
                radial[:, here] = norm * y[l * l + i][:, None] * along[:, functions]
                tangential[:, :, here] = norm * s[l * l - 1 + i][:, :, None] * across[:, functions] if l else 0.0
                column += count
            first += count
        return tangential, radial


@arguments.accepts(
    nearest=arguments.not_negative,
    farthest=arguments.positive,
    n_modes=arguments.whole,
    theory=arguments.a(LinearTheory),
)
def flow_modes(
    nearest: float, farthest: float, n_modes: int = 250, theory: LinearTheory = PLANCK_2018, *, max_degree: int = 60
) -> FlowModes:
    """The modes that hold most of the power of linear flows between two distances.

    Parameters
    ----------
    nearest, farthest : float
        [Mpc/h]; what lies beyond 600 is left to the dispersion.
    n_modes : int
        At most so many; a function of distance brings all orders of its degree.
    theory : LinearTheory
        Planck's unless given.
    max_degree : int
        The highest degree that is tried.

    Raises
    ------
    ParameterError
        If distances do not rise, or there are fewer modes than three, the first of which are the bulk flow.

    Notes
    -----
    Against the covariance of 500 galaxies between 6 and 90 Mpc/h the modes err by 3, 2 and 1 % of its Frobenius
    norm with 250, 500 and 1000 of them.
    """
    nearest, farthest = max(nearest, _NEAREST), min(max(farthest, 1.5 * _NEAREST), FARTHEST)
    if not nearest < farthest:
        raise ParameterError(f"distances of a flow rise, not from {nearest:g} to {farthest:g} Mpc/h")
    if n_modes < 3:
        raise ParameterError(f"{n_modes} modes hold no flow: the first three are the bulk flow")
    return _chosen_modes(nearest, farthest, n_modes, theory, max_degree)


@lru_cache(maxsize=64)  # many skies of the same sources ask for the same
def _chosen_modes(nearest, farthest, n_modes, theory, max_degree):
    radii = np.geomspace(nearest, farthest, _RADII)
    k, step = _wave_numbers(farthest)
    amplitude = theory.growth_rate * HUBBLE * np.sqrt(2 / np.pi * theory.power_at(k) * step) / k
    weight = np.sqrt(np.gradient(radii)) * radii
    weight /= np.sqrt(np.sum(weight**2))
    kr = np.outer(radii, k)
    found: list[tuple[float, int, FloatArray, FloatArray, FloatArray]] = []
    for l in range(max_degree + 1):
        across = np.sqrt(l * (l + 1)) * spherical_jn(l, kr) / radii[:, None] * amplitude
        along = spherical_jn(l, kr, derivative=True) * k * amplitude
        _, power, right = np.linalg.svd(np.vstack([across, along]) * np.tile(weight, 2)[:, None], full_matrices=False)
        origin = k / 3 * amplitude if l == 1 else np.zeros_like(k)
        few = right[: n_modes // (2 * l + 1) + 1].T
        found += zip(power[: few.shape[1]] ** 2, [l] * few.shape[1], (across @ few).T, (along @ few).T, origin @ few)
        # Of a degree above, no function holds more than the first of this one: there is nothing left to come.
        if l > 1 and sum(2 * each[1] + 1 for each in found if each[0] > power[0] ** 2) >= n_modes:
            break
    chosen: list[tuple[float, int, FloatArray, FloatArray, FloatArray]] = []
    for each in sorted(found, key=lambda each: -each[0]):
        if sum(2 * l + 1 for _, l, *_ in [*chosen, each]) > n_modes:
            break
        chosen.append(each)
    chosen.sort(key=lambda each: (each[1], -each[0]))
    counts = tuple(sum(l == each[1] for each in chosen) for l in range(max(each[1] for each in chosen) + 1))
    return FlowModes(
        theory, counts, radii, np.stack([each[2] for each in chosen], 1), np.stack([each[3] for each in chosen], 1),
        np.array([each[4] for each in chosen]),
    )  # fmt: skip


def _wave_numbers(farthest, highest=0.6):
    """Wave numbers and the step at each: even in ln k where k is small, and fine enough for the largest distance."""
    small = np.geomspace(2e-4, 0.02, 40)
    edges = np.sqrt(small[1:] * small[:-1])
    step = min(0.004, 0.6 / farthest)
    large = np.arange(0.02 + step / 2, highest, step)
    return np.r_[small, large], np.r_[np.diff(np.r_[small[0] ** 2 / edges[0], edges, 0.02]), np.full(large.size, step)]
