"""Passes by whichever way there is: compiled, or by a sparse matrix."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from sim.agis.passes._scans import Scans
from sim.agis.passes._sparse import MAX_TRANSITS, SparsePasses
from vsh.tools.errors import ParameterError
from vsh.tools.types import BoolArray, FloatArray


class Passes(Protocol):
    """What passes over the observations of some transits do; x are of sources, h of the attitude."""

    def to_attitude(self, x: FloatArray) -> FloatArray:
        """Cᵀ x, (coefficients, 3, K)."""
        ...

    def to_sources(self, h: FloatArray) -> FloatArray:
        """C h, (n, 5, K)."""
        ...

    def predict(self, x: FloatArray, h: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What parameters make of the observations: along and across, (k,) each."""
        ...

    def adjoint(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its weighted transpose, (n, 5) and (coefficients, 3)."""
        ...

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """S as (n, 5, 5), and the lower band of A."""


def make_passes(scans: Scans, solved: BoolArray, threads: int | None = None, compiled: bool | None = None) -> Passes:
    """Passes over the transits of the sources that are solved; the others weigh nothing."""
    table = np.stack([*scans.directions, *(scans.weights * solved).astype(np.float32)], axis=1)
    if compiled is not False:
        try:
            from sim.agis.passes._compiled import CompiledPasses  # numba
        except ImportError:
            if compiled or len(scans) > MAX_TRANSITS:
                raise ParameterError(
                    f"{len(scans)} transits are too many without numba: pip install 'vsh-astrometry[agis]'"
                ) from None
        else:
            return CompiledPasses(scans, table, threads)
    return SparsePasses(scans, table)
