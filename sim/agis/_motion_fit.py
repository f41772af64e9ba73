"""A fit of vector spherical harmonics to the motions of a joint solution, as functionals of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.agis.passes import Scans
from vsh.basis import harmonics
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.types import ArrayLike, FloatArray, IntArray

#: Degrees that must come to rest.
LOW_DEGREES = 3


class MotionFit:
    """The weighted fit that takes sources for independent, with their formal covariances."""

    def __init__(self, equations: Any, modes: Modes, sources: IntArray) -> None:
        self.modes, self.equations = modes, equations
        self.sources = sources[equations.solved[sources]]
        scans = equations.scans
        field = harmonics(scans.lon[self.sources], scans.lat[self.sources], modes)
        weights = np.linalg.inv(equations.formal[self.sources][:, 3:, 3:])
        weighted = np.einsum("nij,pjn->pin", weights, field)
        normal = field.reshape(len(modes), -1) @ weighted.reshape(len(modes), -1).T
        scale = 1 / np.sqrt(np.diag(normal))
        if np.linalg.eigvalsh(normal * np.outer(scale, scale))[0] < 1e-10:
            raise DegeneracyError(f"{len(self.sources)} sources do not determine degree {modes.lmax}: lower it")
        #: As quoted, (p, p).
        self.formal = np.linalg.inv(normal)
        self.rows = np.tensordot(self.formal, weighted, 1)

    def of(self, x: FloatArray) -> FloatArray:
        """Coefficients of given parameters, (p, K)."""
        motions = x[self.sources, 3:].transpose(1, 0, 2)
        return self.rows.reshape(len(self.modes), -1) @ motions.reshape(-1, x.shape[-1])

    def functionals(self, which: ArrayLike) -> FloatArray:
        """The g of some coefficients, c = Σ g x: (n, 5, K)."""
        rows = self.rows[np.asarray(which)]
        out = np.zeros((self.equations.scans.n_sources, 5, len(rows)))
        out[self.sources, 3:] = rows.transpose(2, 1, 0)
        return out


def low_fit(equations: Any, sources: IntArray) -> MotionFit:
    """The fit whose coefficients must come to rest: to degree three, or as high as the sources determine."""
    for degree in range(LOW_DEGREES, 0, -1):
        if len(Modes(degree)) < 2 * equations.solved[sources].sum():
            try:
                return MotionFit(equations, Modes(degree), sources)
            except DegeneracyError:
                continue
    raise DegeneracyError(f"{len(sources)} sources determine no spin and acceleration, by which iterations stop")


def sources_at(scans: Scans, lon: ArrayLike | None, lat: ArrayLike | None) -> IntArray:
    """Indices of the sources at given positions; all where none are given."""
    if lon is None and lat is None:
        return np.arange(scans.n_sources)
    lon = arguments.dimension(1)("lon", lon)
    lat = arguments.float_array("lat", lat, lon.shape)
    if lon.shape == scans.lon.shape and (lon == scans.lon).all() and (lat == scans.lat).all():
        return np.arange(scans.n_sources)
    places = {place: i for i, place in enumerate(zip(scans.lon.tolist(), scans.lat.tolist(), strict=True))}
    found = [places.get(place, -1) for place in zip(lon.tolist(), lat.tolist(), strict=True)]
    if -1 in found:
        raise ParameterError(
            f"{found.count(-1)} of {len(found)} positions are of no source of the scans (first: {found.index(-1)})"
        )
    return np.array(found)
