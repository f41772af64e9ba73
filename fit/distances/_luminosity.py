"""How bright galaxies are: the luminosity function, fitted to a catalogue that is complete to a magnitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.distances._curve import LogCurve, curve_basis, fit_log_curve
from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray
from vsh.errors import DegeneracyError

#: Cells of absolute magnitude and of distance modulus, by their lower ends.
_STEP = 0.1
MAGNITUDES = np.arange(-32.0, 12.0, _STEP)
MODULI = np.arange(20.0, 60.0, _STEP)
#: Fewer sources than this say nothing of a luminosity function.
_LEAST = 30


@dataclass(frozen=True, eq=False)
class LuminosityFunction(InNotebook):
    """The density of galaxies by absolute magnitude, up to a factor.

    Attributes
    ----------
    curve : function
        From absolute magnitudes, for the cosmology's H0, to log φ.
    words : str
        For reports.
    """

    curve: Any
    words: str

    def log(self, magnitude: FloatArray) -> FloatArray:
        """log φ(M).

        Parameters
        ----------
        magnitude : array
            Absolute.
        """
        return self.curve(magnitude)


def magnitude_counts(magnitude: FloatArray, modulus: FloatArray) -> FloatArray:
    """Sources by absolute magnitude and distance modulus, a table that adds over parts."""
    edges = [np.r_[each, each[-1] + _STEP] for each in (MAGNITUDES, MODULI)]
    return np.histogram2d(magnitude - modulus, modulus, bins=edges)[0]


def fit_luminosity(counts: FloatArray, limit: float) -> LuminosityFunction:
    """The luminosity function by which counts of a magnitude-limited catalogue are most probable.

    Of each distance only the shape of the counts matters, so that neither density nor clusters bear on it
    (Sandage, Tammann & Yahil 1979, ApJ 232, 352; the curve is free as that of Efstathiou, Ellis & Peterson 1988,
    MNRAS 232, 431).
    """
    total = counts.sum()
    if total < _LEAST:
        raise DegeneracyError(
            f"{total:.0f} galaxies with magnitudes say nothing of a luminosity function: give one (luminosity=), or use no "
            "magnitudes (magnitudes=False)"
        )
    by_magnitude = counts.sum(1)
    share = np.cumsum(by_magnitude) / total
    low, high = MAGNITUDES[np.searchsorted(share, [0.005, 0.995])]
    knots = np.linspace(low, max(high, low + 1.0), 8 if total > 1000 else 5)
    middle = MAGNITUDES + _STEP / 2
    used = (middle > low - 3) & (middle < high + 3)
    far = counts.sum(0) > 0
    open_to = (middle[used] + MODULI[far, None] <= limit).astype(float)
    seen = counts[used][:, far].T * open_to
    values = fit_log_curve(curve_basis(knots, middle[used]), seen, open_to)
    return LuminosityFunction(
        LogCurve(knots, values), f"luminosity function of {total:.0f} galaxies to magnitude {limit:.2f}"
    )
