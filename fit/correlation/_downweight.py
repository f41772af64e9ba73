"""Downweighting dense regions until spin and acceleration are uncorrelated, at the least cost in error."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.correlation._forecast import Prediction, predict_covariance, reweighted
from fit.solution import at_sources
from fit.storage import Result
from vsh import Coefficients
from vsh.field import Field
from vsh.io import tables
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ConvergenceError, ParameterError
from vsh.tools.types import ArrayLike, Axes, BoolArray, FloatArray, Rng, Table
from vsh.vector import correlation_of


@dataclass(frozen=True, eq=False)
class Downweighted(Result):
    """How much of each part of the sky to keep.

    Attributes
    ----------
    keep : (12 nside²,) array
        Share of the weight of each pixel, 0 to 1; nan where there are no sources.
    factors : (n,) array
        The same for each source: factors on its weight.
    before, after : Prediction
        Predictions of degree 1.
    """

    keep: FloatArray
    factors: FloatArray
    before: Prediction
    after: Prediction

    def report(self) -> str:
        """What it costs and what it gains, as text."""
        lines = [f"{np.nanmean(self.factors):.0%} of the weight is kept"]
        for words, prediction in (("before", self.before), ("after", self.after)):
            value, pair = prediction.largest
            lines.append(
                f"{words:7} largest correlation {value:+.3f}, of {pair[0]} and {pair[1]}; errors of spin "
                f"{np.sqrt(np.mean(prediction.spin.sigma**2)):.3g}, of acceleration "
                f"{np.sqrt(np.mean(prediction.acceleration.sigma**2)):.3g} µas/yr"
            )
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """Share of the weight to keep in each pixel, as an astropy Table in ring order."""
        return tables.table_of({"keep": self.keep}, {"frame": self.after.frame})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The shares as a map; on matplotlib axes."""
        from fit.correlation._plot import plot_shares

        return plot_shares(self.keep, self.after.frame, ax=ax)

    def mask(self, rng: Rng) -> BoolArray:
        """Which sources to keep, (n,), if whole ones are drawn by `rng` with these shares."""
        return generator(rng).uniform(size=len(self.factors)) < self.factors


@arguments.accepts(max_correlation=arguments.number, nside=arguments.whole)
def downweight(sources: Any, max_correlation: float, *, nside: int = 4, sigma: ArrayLike | None = None) -> Downweighted:
    """Shares of the weight in each pixel that bring all correlations of spin and acceleration under a bound.

    Parameters
    ----------
    sources : Field, or positions with errors
        As for `fit.correlation.predict_covariance`.
    max_correlation : float
        Between 0 and 1.
    nside : int
        Resolution of the pixels.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Raises
    ------
    ConvergenceError
        If no weights reach the bound.

    Notes
    -----
    Minimises log det of the covariance of the six components over the shares, under
    |ρ| ≤ bound for all pairs, by sequential quadratic programming with exact derivatives.
    """
    from vsh.sky.pixels import pixels_of

    if not 0 < max_correlation < 1:
        raise ParameterError(f"a bound on correlations lies between 0 and 1, not at {max_correlation}")
    field = Field.without_motions(sources, sigma)
    pixels = pixels_of(field.lon, field.lat, nside)
    used, index = np.unique(pixels, return_inverse=True)
    parts = _normal_by_pixel(field, index, len(used))
    parts /= np.trace(parts.sum(0)) / 6
    pairs = np.triu_indices(6, 1)

    def covariance(keep):
        return np.linalg.inv(np.tensordot(keep, parts, 1))

    def cost(keep):
        c = covariance(keep)
        return np.linalg.slogdet(c)[1], -np.einsum("ij,kji->k", c, parts)

    def slack(keep):
        rho = correlation_of(covariance(keep))[pairs]
        return np.concatenate([limit - rho, limit + rho])

    def slope(keep):
        c = covariance(keep)
        sigma = np.sqrt(np.diag(c))
        change = -c @ parts @ c
        rho = correlation_of(c)
        relative = np.einsum("kii->ki", change) / np.diag(c)
        d_rho = change / np.outer(sigma, sigma) - rho / 2 * (relative[:, :, None] + relative[:, None, :])
        d_rho = d_rho[:, pairs[0], pairs[1]].T
        return np.concatenate([-d_rho, d_rho])

    # The bound is lowered step by step, each from the last solution: at once, it is often out of sight.
    keep, limit = np.full(len(used), 0.999), np.array(max_correlation)
    first = np.abs(correlation_of(covariance(keep))[pairs]).max()
    for bound in np.geomspace(max(first, max_correlation), max_correlation, 12):
        limit[()] = bound
        from scipy.optimize import minimize  # slow to import

        minimum = minimize(
            cost,
            keep,
            jac=True,
            method="SLSQP",
            bounds=[(1e-6, 1.0)] * len(used),
            constraints={"type": "ineq", "fun": slack, "jac": slope},
            options={"maxiter": 200, "ftol": 1e-8},
        )
        keep = np.clip(minimum.x, 1e-6, 1.0)
    keep[keep < 1e-5] = 0.0
    if slack(keep).min() < -1e-3:
        raise ConvergenceError(
            f"no weights bring all correlations under {max_correlation:g} ({minimum.message}): take a larger bound"
        )
    full = np.full(12 * nside**2, np.nan)
    full[used] = keep
    return Downweighted(
        full, keep[index], predict_covariance(field, 1), predict_covariance(reweighted(field, keep[index]), 1)
    )


def _normal_by_pixel(field, index, count):
    """N of spin and acceleration from the sources of each pixel, (count, 6, 6)."""
    axes = np.eye(3)
    vectors = [Coefficients.from_vectors(rotation=axis) for axis in axes]
    vectors += [Coefficients.from_vectors(glide=axis) for axis in axes]
    basis = [at_sources(vector, field) for vector in vectors]
    parts = np.empty((count, 6, 6))
    for i in range(6):
        for j in range(i + 1):
            parts[:, i, j] = parts[:, j, i] = np.bincount(index, field.inner(basis[i], basis[j]), count)
    return parts
