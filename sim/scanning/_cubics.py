"""A function between even steps, where its values and slopes are known: cubics that have both."""

import numpy as np

from vsh.tools.types import FloatArray


class Cubics:
    """The cubic polynomials that have given values and slopes at even steps from zero.

    Parameters
    ----------
    step : float
        Between two places.
    values, slopes : (m,) arrays
        At 0, step, 2 step, …
    """

    def __init__(self, step: float, values: FloatArray, slopes: FloatArray) -> None:
        low, rise, ahead = values[:-1], np.diff(values), step * slopes[1:]
        start = step * slopes[:-1]
        self.step, self.powers = step, np.stack([low, start, 3 * rise - 2 * start - ahead, start + ahead - 2 * rise])

    def __call__(self, x: FloatArray) -> FloatArray:
        """Its values at places x, (n,)."""
        (a, b, c, d), part = self._at(x)
        return a + part * (b + part * (c + part * d))

    def slope(self, x: FloatArray) -> FloatArray:
        """Its slopes there."""
        (_, b, c, d), part = self._at(x)
        return (b + part * (2 * c + part * 3 * d)) / self.step

    def _at(self, x):
        """Powers of the interval of each place, and how far into it that is; beyond the ends they go on."""
        along = np.asarray(x, float) / self.step
        index = np.clip(along.astype(int), 0, self.powers.shape[1] - 1)
        return self.powers[:, index], along - index
