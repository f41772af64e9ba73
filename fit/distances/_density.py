"""How many sources there are at each distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.distances._curve import LogCurve, curve_basis, fit_log_curve
from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray
from vsh.cosmology import transverse_distance

#: Cells of ln z in which redshifts are counted.
EDGES = np.arange(np.log(1e-4), np.log(30.0), 0.02)


@dataclass(frozen=True, eq=False)
class SourceDensity(InNotebook):
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


@dataclass(frozen=True, eq=False)
class Completed:
    """The density of all sources, from that of those which a catalogue complete to a magnitude holds.

    Attributes
    ----------
    curve : LogCurve
        Of those in the catalogue, from ln d.
    log_distance, log_share : (k,) arrays
        ln d, and the logarithm of the share of all that are bright enough.
    """

    curve: LogCurve
    log_distance: FloatArray
    log_share: FloatArray

    def __call__(self, log_distance: FloatArray) -> FloatArray:
        return self.curve(log_distance) - np.interp(log_distance, self.log_distance, self.log_share)


def completed(density: SourceDensity, luminosity: Any, limit: float, log_distance: Any) -> SourceDensity:
    """The density of all sources behind that of a magnitude-limited catalogue."""
    x = np.geomspace(1e-4, np.log(30.0), 600)
    log_d, _ = log_distance(x)
    faintest = limit - 5 / np.log(10) * (log_d + x) - 25
    magnitude = np.linspace(faintest.min() - 12, faintest.max(), 6000)
    log = luminosity.log(magnitude)
    share = np.log(np.cumsum(np.exp(log - log.max())))
    return SourceDensity(Completed(density.curve, log_d, np.interp(faintest, magnitude, share)), density.words)


def redshift_counts(redshift: FloatArray) -> FloatArray:
    """Sources by redshift, a table that adds over parts."""
    return np.histogram(np.log(redshift), bins=EDGES)[0].astype(float)


def flow_counts(redshift: FloatArray, weight: FloatArray) -> FloatArray:
    """What sources tell of a velocity, their weight times 1/d², by redshift: a table that adds over parts.

    Parameters
    ----------
    redshift : (n,) array
        None missing or below 1e-4.
    weight : (n,) array
        Of their motions. [(yr/µas)²]

    Returns
    -------
    array
        A number for each cell of ln z.
    """
    return np.histogram(np.log(redshift), bins=EDGES, weights=weight / transverse_distance(redshift) ** 2)[0]


def flow_limits(counts: FloatArray) -> tuple[float, float]:
    """Redshifts between which all but a hundredth of that lies: a flow beyond them moves no estimate."""
    share = np.cumsum(counts) / max(counts.sum(), 1e-300)
    first, last = np.argmax(share > 1e-4), np.argmax(share > 0.99)
    return float(np.exp(EDGES[first])), float(np.exp(EDGES[last + 1]))


def fit_density(
    counts: FloatArray,
    spread: float,
    log_distance: Any,
    limits: tuple[float, float],
    cut: tuple[float, float] | None = None,
) -> SourceDensity:
    """The density of what a catalogue holds, by which its redshifts are most probable, errors and velocities in them."""
    if cut is not None and cut[1] > cut[0] > 0:
        inner = np.searchsorted(EDGES, np.log(cut)) - 1
        if inner[1] - inner[0] > 8 and counts[inner[0] : inner[1]].sum() > 0.2 * counts.sum():
            limits = cut
    first, last = np.searchsorted(EDGES, np.log(limits)) - 1
    if last - first > 8:  # cells at the ends are cut by the catalogue's own limits
        first, last = first + 1, last - 1
    first = max(first, 0)
    cells, seen = slice(first, last + 1), np.log1p(np.exp(EDGES[first : last + 2]))
    low = max(np.log1p(1e-4), seen[0] - 5 * spread)
    true = np.linspace(low, seen[-1] + 5 * spread, 600)
    from scipy.special import ndtr

    kernel = np.diff(ndtr((seen[:, None] - true) / max(spread, 1e-9)), axis=0)
    log_d, log_volume = log_distance(true)
    # Beyond what is seen the curve goes on straight.
    inner = log_d[(true >= seen[0]) & (true <= seen[-1])]
    knots = np.linspace(inner[0], inner[-1], int(np.clip(np.ceil(inner[-1] - inner[0]) + 1, 4, 8)))
    shares = kernel * np.exp(log_volume - log_volume.max())
    values = fit_log_curve(curve_basis(knots, log_d), counts[cells][None], shares[None])
    return SourceDensity(LogCurve(knots, values), f"as the catalogue's {counts.sum():.0f} redshifts have it")
