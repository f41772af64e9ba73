"""Which source is seen when, and under which angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsh.checks.frozen import Frozen
from vsh.checks.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Transits(Frozen):
    """Passages of sources over a field of view, ordered by source and, for each, by time.

    Attributes
    ----------
    source : (k,) int array
        Index of the source.
    time : (k,) array
        Since the start of the mission [yr]
    angle : (k,) array
        Position angle of the scan, from north through east [rad]
    parallax_factor : (k,) array
        Along-scan shift for a parallax of one.
    view : (k,) int array
        +1 for the preceding, −1 for the following field of view.
    across : (k,) array
        Across-scan offset from the middle of the field [rad]
    """

    source: FloatArray
    time: FloatArray
    angle: FloatArray
    parallax_factor: FloatArray
    view: FloatArray
    across: FloatArray

    def __len__(self) -> int:
        return len(self.source)

    def counts(self, n: int) -> IntArray:
        """How many each of n sources has, (n,).

        Parameters
        ----------
        n : int
            Sources.
        """
        return np.bincount(self.source, minlength=n)
