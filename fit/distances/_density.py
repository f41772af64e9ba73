"""How many sources there are at each distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.distances._curve import LogCurve, curve_basis, fit_log_curve
from vsh.types import FloatArray

#: Cells of ln z in which redshifts are counted.
_EDGES = np.arange(np.log(1e-4), np.log(30.0), 0.02)


@dataclass(frozen=True, eq=False)
class SourceDensity:
    """The number of sources per comoving volume, up to a factor.

    Attributes
    ----------
    curve : function or None
        From ln d [Mpc] to its logarithm; None is one density everywhere.
    words : str
        For reports.
    """

    curve: Any = None
    words: str = "evenly in volume"

    def log(self, distance: FloatArray) -> FloatArray:
        """The logarithm of the density.

        Parameters
        ----------
        distance : array
            [Mpc]
        """
        return np.zeros(np.shape(distance)) if self.curve is None else self.curve(np.log(distance))


@dataclass(frozen=True)
class GivenDensity:
    """The logarithm of a function of distance, as a function of its logarithm."""

    function: Callable[[FloatArray], FloatArray]

    def __call__(self, log_distance: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            return np.log(np.asarray(self.function(np.exp(log_distance)), float))


def redshift_counts(redshift: FloatArray) -> FloatArray:
    """Sources by redshift, a table that adds over parts.

    Parameters
    ----------
    redshift : (n,) array
        At rest in the microwave background.
    """
    return np.histogram(np.log(redshift), bins=_EDGES)[0].astype(float)


def fit_density(counts: FloatArray, spread: float, log_distance: Any, limits: tuple[float, float]) -> SourceDensity:
    """The density of what a catalogue holds, by which its redshifts are most probable, errors and velocities in them.

    Parameters
    ----------
    counts : array
        Of `redshift_counts`.
    spread : float
        The rms error of ln(1 + z).
    log_distance : function
        From ln(1 + z) to ln d and the logarithm of the volume per ln(1 + z), but for a factor.
    limits : pair of float
        The smallest and largest redshift.
    """
    first, last = np.searchsorted(_EDGES, np.log(limits)) - 1
    cells = slice(max(first, 0), last + 1)
    seen = np.log1p(np.exp(_EDGES[max(first, 0) : last + 2]))
    low = max(np.log1p(1e-4), seen[0] - 5 * spread)
    true = np.linspace(low, seen[-1] + 5 * spread, 600)
    from scipy.special import ndtr

    kernel = np.diff(ndtr((seen[:, None] - true) / max(spread, 1e-9)), axis=0)
    log_d, log_volume = log_distance(true)
    # Beyond what is seen the curve goes on straight.
    inner = log_d[(true >= seen[0]) & (true <= seen[-1])]
    knots = np.linspace(inner[0], inner[-1], 6)
    shares = kernel * np.exp(log_volume - log_volume.max())
    values = fit_log_curve(curve_basis(knots, log_d), counts[cells][None], shares[None])
    return SourceDensity(LogCurve(knots, values), f"as the catalogue's {counts.sum():.0f} redshifts have it")
