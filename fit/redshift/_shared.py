"""Flows that galaxies share, as the bins of redshift see them.

A flow moves whole neighbourhoods: it does not average out over the sources of a bin, and neighbouring bins share it. Of
every bin's normal equations N c = b it changes b by X a, with X = Σ Aᵀ W F over its sources, F the modes of a flow, and a
their amplitudes, one on average. The coefficients of all bins then have the covariance (N⁻¹X)(N⁻¹X)ᵀ more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fit.distances import flow_counts, flow_limits
from fit.secular_parallax import LEFT_DISPERSION, modes_within
from vsh.basis import harmonics
from vsh.checks.types import FloatArray
from vsh.cosmology import FLOW_LIMIT, PLANCK_2013, hubble_value, usable
from vsh.field import Field
from vsh.flows import FlowModes, LinearTheory
from vsh.modes import Modes
from vsh.parts import Parts, as_parts
from vsh.units import AU_PER_YEAR

#: From this share in a variance on, a flow matters to the tests of bins.
FLOW_MATTERS = 0.05
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class SharedFlow:
    """The modes of a flow over the distances of a catalogue, and what galaxies move beside it.

    Attributes
    ----------
    theory : LinearTheory
    modes : FlowModes
    dispersion : float
        Of peculiar velocities beside the flow. [km/s]
    """

    theory: LinearTheory
    modes: FlowModes
    dispersion: float

    def of(self, field: Field, rate: FloatArray, modes: Modes) -> tuple[Field, FloatArray]:
        """Sources with errors that hold their own motions, and X (p, m) of those within reach of the flow."""
        near = np.flatnonzero(rate > 0)
        distance = hubble_value(PLANCK_2013) / 100 / (AU_PER_YEAR * rate[near])
        left = np.full(near.size, self.theory.sigma**2)
        reach = distance <= self.modes.radii[-1]
        left[reach] = self.modes.left(distance[reach])[0]
        added = np.zeros(len(field))
        added[near] = rate[near] ** 2 * (left + self.dispersion**2)
        sigma = np.sqrt(field.sigma**2 + added)
        field = field.with_errors(sigma, field.rho * np.prod(field.sigma, 0) / np.prod(sigma, 0))
        near, distance = near[reach], distance[reach]
        total = np.zeros((len(modes), len(self.modes)))
        a, b, c = field.weights
        for start in range(0, near.size, _BLOCK):
            rows, far = near[start : start + _BLOCK], distance[start : start + _BLOCK]
            east, north = self.modes.at(field.lon[rows], field.lat[rows], far)[0] * rate[rows, None]
            basis = harmonics(field.lon[rows], field.lat[rows], modes)
            total += (basis[:, 0] * a[rows] + basis[:, 1] * c[rows]) @ east
            total += (basis[:, 0] * c[rows] + basis[:, 1] * b[rows]) @ north
        return field, total


def _counts(field, low, high):
    if field.redshift is None:
        return 0.0
    inside = usable(field.redshift) & (field.redshift >= low) & (field.redshift < high)
    return flow_counts(field.redshift[inside], field.information[inside]) if inside.any() else 0.0


def shared_flow(
    field: Any, edges: FloatArray, theory: LinearTheory, dispersion: float | None, n_modes: int
) -> SharedFlow | None:
    """The flow of the sources between some redshifts; None where they are all beyond its reach."""
    low, high = max(edges[0], FLOW_LIMIT), max(edges[-1], FLOW_LIMIT)
    if isinstance(field, Field | Parts):
        counts = as_parts(field).sum(partial(_counts, low=low, high=high), roles=("redshift",), words="redshifts")
        if np.any(counts):
            low, high = flow_limits(counts)
    modes = modes_within((low, high), PLANCK_2013, theory, n_modes)
    return None if modes is None else SharedFlow(theory, modes, LEFT_DISPERSION if dispersion is None else dispersion)
