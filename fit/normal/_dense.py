"""Normal equations of sources whose errors are correlated with each other: whitened all together, and then summed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.normal._equations import NormalEquations
from vsh.basis import harmonics
from vsh.checks.frozen import Frozen
from vsh.checks.types import ArrayLike, FloatArray
from vsh.covariance import as_covariance
from vsh.field import Field
from vsh.modes import Modes


@dataclass(frozen=True, eq=False)
class WhiteRows(Frozen):
    """The equations of n sources, whitened by their dense covariance: 2n independent rows of unit weight.

    The rows of a source are what its motion says that those of the sources before it do not: rows can be left out and
    drawn again like sources with errors of their own.

    Attributes
    ----------
    modes : Modes
    rows : (p, 2, n) array
        The whitened harmonics.
    motion : (2, n) array
        The whitened motions.
    frame : str
    notes : tuple of str
    """

    modes: Modes
    rows: FloatArray
    motion: FloatArray
    frame: str
    notes: tuple[str, ...]

    @classmethod
    def of(cls, field: Field, modes: Modes, covariance: Any) -> WhiteRows:
        """Those of a field."""
        shared = as_covariance(covariance, field)
        p, n = len(modes), len(field)
        rows = shared.whiten(harmonics(field.lon, field.lat, modes).reshape(p, 2 * n)).reshape(p, 2, n)
        return cls(modes, rows, shared.whiten(field.motion.ravel()).reshape(2, n), field.frame, field.notes)

    def __len__(self) -> int:
        return self.motion.shape[1]

    def __getitem__(self, keep: Any) -> WhiteRows:
        return WhiteRows(self.modes, self.rows[..., keep], self.motion[:, keep], self.frame, self.notes)

    def normal_equations(self, times: ArrayLike = 1.0) -> NormalEquations:
        """The sum of their rows, those of each source so many times."""
        times = np.broadcast_to(np.asarray(times, float), self.motion.shape).ravel()
        rows, motion = self.rows.reshape(len(self.modes), -1), self.motion.ravel()
        weighted = rows * times
        return NormalEquations(self.modes, weighted @ rows.T, weighted @ motion, float(times @ motion**2),
                               2 * len(self), self.frame, self.notes)  # fmt: skip
