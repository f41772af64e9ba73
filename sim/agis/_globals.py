"""Motions that follow a global field, solved for inside the joint solution."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sim.agis.passes import Scans
from sim.astrometry import smallest_eigenvalue
from vsh.basis import harmonics
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class GlobalMotion(Frozen):
    """A field of k parameters that the motions of some sources follow to within a scatter.

    The parameters y are solved for with everything else: a source's motion is G y plus one of its own, of standard
    deviation `scatter`. That is a penalty (µ − G y)ᵀ P (µ − G y) with P = 1/scatter²; y is eliminated from it.

    Attributes
    ----------
    design : (n, 2, k) array
        East and north motion of each source for each parameter of one; zero where P is.
    weights : (n,) array
        P: zero for sources whose motions are free, as of stars. [yr²/µas²]
    names : tuple of str
        Names of the parameters.
    spins : bool
        Whether a rotation of the sky is among the parameters; if none is, sources that follow the field do not rotate.
    """

    design: FloatArray
    weights: FloatArray
    names: tuple[str, ...]
    spins: bool

    def check(self, n: int, solved: BoolArray) -> None:
        """Raise ParameterError unless it is of `n` sources, enough of which are `solved`.

        Raises
        ------
        ParameterError
            If not.
        """
        if len(self.design) != n:
            raise ParameterError(f"a global motion of {len(self.design)} sources, and scans of {n}")
        if 2 * np.sum(solved & (self.weights > 0)) < len(self.names):
            raise ParameterError(f"too few sources for {len(self.names)} global parameters")

    @cached_property
    def normal(self) -> FloatArray:
        """Gᵀ P G, (k, k)."""
        return np.einsum("nik,n,nil->kl", self.design, self.weights, self.design)

    def parameters(self, x: FloatArray) -> FloatArray:
        """y for given parameters of the sources `x`, (n, 5, K): (k, K)."""
        return np.linalg.solve(self.normal, np.einsum("nik,n,nir->kr", self.design, self.weights, x[:, 3:]))

    def pull(self, x: FloatArray) -> FloatArray:
        """P G y of the field that fits parameters of the sources `x`, (n, 5, K), best: (n, 2, K)."""
        return self.weights[:, None, None] * np.einsum("nik,kr->nir", self.design, self.parameters(x))

    def functional(self, k: int) -> FloatArray:
        """The g of parameter `k`: y_k = Σ g x, (n, 5)."""
        functional = np.zeros((len(self.design), 5))
        inverse_column = np.linalg.solve(self.normal, np.eye(len(self.names))[k])
        functional[:, 3:] = self.weights[:, None] * np.einsum("nik,k->ni", self.design, inverse_column)
        return functional

    def reduced(self, formal: FloatArray) -> FloatArray:
        """Gᵀ (P⁻¹ + Σ)⁻¹ G with the covariances Σ of the motions in `formal` (n, 5, 5): what sources tell of y."""
        has_weight = self.weights > 0
        covariance = formal[has_weight][:, 3:, 3:] + (1 / self.weights[has_weight])[:, None, None] * np.eye(2)
        return np.einsum("nik,nij,njl->kl", self.design[has_weight], np.linalg.inv(covariance), self.design[has_weight])


def global_motion(
    lon: ArrayLike, lat: ArrayLike, modes: Modes | int = 1, *, scatter: ArrayLike = 10.0, spin: bool = True
) -> GlobalMotion:
    """Motions that follow vector spherical harmonics.

    Parameters
    ----------
    lon, lat : (n,) arrays
        Positions of all sources. [rad]
    modes : Modes, or the degree lmax
        Modes of the field.
    scatter : float or (n,) array
        Scatter of the motions about it; infinite for sources whose motions are free. [µas/yr]
    spin : bool
        With the rotation, so that the frame stays free; else only a frame in which sources do not rotate is left.

    Raises
    ------
    ParameterError
        If a scatter is not above zero, or shapes disagree.
    """
    lon, modes = arguments.array_with_dimensions(1)("lon", lon), as_modes(modes)
    lat = arguments.float_array("lat", lat, lon.shape)
    scatters = arguments.float_array("scatter", scatter, lon.shape, finite=False, broadcast=True)
    if not (scatters > 0).all():
        raise ParameterError(f"{np.sum(~(scatters > 0))} scatters of motions are zero or negative")
    basis = harmonics(lon, lat, modes)
    names = [str(mode) for mode in modes]
    if not spin:
        mask = np.ones(len(modes), bool)
        mask[modes.slice_of("T", 1)] = False
        basis, names = basis[mask], [name for name, is_included in zip(names, mask, strict=True) if is_included]
    weights = 1 / scatters**2
    return GlobalMotion(basis.transpose(2, 1, 0) * (weights > 0)[:, None, None], weights, tuple(names), bool(spin))


#: Degrees that must come to rest.
MAX_LOW_DEGREE = 3


#: Sources that are looked at together.
_BLOCK_SOURCES = 2**16


def make_source_slices(n: int) -> Iterator[slice]:
    """Sources so many at a time that no copy of theirs is large."""
    return (slice(start, min(start + _BLOCK_SOURCES, n)) for start in range(0, n, _BLOCK_SOURCES))


class MotionFit:
    """The weighted fit that takes sources for independent, with their formal covariances."""

    def __init__(self, equations: Any, modes: Modes, sources: IntArray) -> None:
        self.modes, self.equations = modes, equations
        self.sources = sources[equations.solved[sources]]
        scans, p = equations.scans, len(modes)
        normal = np.zeros((p, p))
        #: What a source's motion adds to the right-hand sides, (p, 2, k).
        self.weighted_harmonics = scans.array(p, 2, len(self.sources))
        for chunk in make_source_slices(len(self.sources)):
            source_rows = self.sources[chunk]
            basis = harmonics(scans.lon[source_rows], scans.lat[source_rows], modes)
            weights = np.linalg.inv(equations.formal[source_rows][:, 3:, 3:])
            self.weighted_harmonics[:, :, chunk] = weighted_basis = np.einsum("nij,pjn->pin", weights, basis)
            normal += basis.reshape(p, -1) @ weighted_basis.reshape(p, -1).T
        if smallest_eigenvalue(normal) < 1e-10:
            raise DegeneracyError(f"{len(self.sources)} sources do not determine degree {modes.lmax}: lower it")
        #: As quoted, (p, p).
        self.formal = np.asarray(np.linalg.inv(normal), float)

    def compute_coefficients(self, x: FloatArray) -> FloatArray:
        """Coefficients of given parameters, (p, K)."""
        motions = x[self.sources, 3:].transpose(1, 0, 2)
        return self.formal @ (self.weighted_harmonics.reshape(len(self.modes), -1) @ motions.reshape(-1, x.shape[-1]))

    def functionals(self, coefficient_indices: ArrayLike) -> FloatArray:
        """The g of some coefficients, c = Σ g x: (n, 5, K)."""
        motion_functionals = np.tensordot(self.formal[np.asarray(coefficient_indices)], self.weighted_harmonics, 1)
        functionals = np.zeros((self.equations.scans.n_sources, 5, len(motion_functionals)))
        functionals[self.sources, 3:] = motion_functionals.transpose(2, 1, 0)
        return functionals


def fit_low_degrees(equations: Any, sources: IntArray) -> MotionFit:
    """The fit whose coefficients must come to rest: to degree three, or as high as the sources determine."""
    for degree in range(MAX_LOW_DEGREE, 0, -1):
        if len(Modes(degree)) < 2 * equations.solved[sources].sum():
            try:
                return MotionFit(equations, Modes(degree), sources)
            except DegeneracyError:
                continue
    raise DegeneracyError(f"{len(sources)} sources determine no spin and acceleration, by which iterations stop")


def find_sources_at(scans: Scans, lon: ArrayLike | None, lat: ArrayLike | None) -> IntArray:
    """Indices of the sources at given positions; all where none are given."""
    if lon is None and lat is None:
        return np.arange(scans.n_sources)
    lon = arguments.array_with_dimensions(1)("lon", lon)
    lat = arguments.float_array("lat", lat, lon.shape)
    if lon.shape == scans.lon.shape and (lon == scans.lon).all() and (lat == scans.lat).all():
        return np.arange(scans.n_sources)
    index_at = {position: i for i, position in enumerate(zip(scans.lon.tolist(), scans.lat.tolist(), strict=True))}
    rows = [index_at.get(position, -1) for position in zip(lon.tolist(), lat.tolist(), strict=True)]
    if -1 in rows:
        raise ParameterError(
            f"{rows.count(-1)} of {len(rows)} positions are of no source of the scans (first: {rows.index(-1)})"
        )
    return np.array(rows)
