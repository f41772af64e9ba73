"""What flows that galaxies share would add to an estimate that takes none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fit.distances import Calibration
from fit.secular_parallax._equations import ParallaxSums
from fit.secular_parallax._parts import equations
from vsh.checks.types import FloatArray
from vsh.field import Field
from vsh.flows import FlowModes
from vsh.parts import Parts

#: So many sources tell the size of what is left out to a few per cent.
_SOURCES = 20_000


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A catalogue whose flow is left out of its equations, and the modes that would hold it."""

    field: Field | Parts
    calibration: Calibration
    modes: FlowModes
    options: dict[str, Any]

    def sums(self, spread: float, excess_noise: float, n_sources: int) -> ParallaxSums:
        """Sums of some sources, weighed as without the flow, with its columns; scaled to those of all."""
        step = max(1, n_sources // _SOURCES)
        some = self.field.map(partial(_every, step=step)) if isinstance(self.field, Parts) else self.field[::step]
        rows = equations(some, self.calibration, modes=self.modes, **self.options)
        sums = rows.sums(spread, excess_noise)
        return replace(sums, matrix=sums.matrix * step, rhs=sums.rhs * step)


def flow_covariance(sums: ParallaxSums, to_u: FloatArray, ratio: float) -> FloatArray:
    """The covariance that a flow gives to parameters which were fitted without it."""
    width = len(to_u)
    normal = to_u.T @ sums.matrix[:width, :width] @ to_u
    carried = np.linalg.solve(normal, to_u.T @ sums.matrix[:width, width:]) * ratio
    return carried @ carried.T


def _every(field, step):
    return field[::step]
