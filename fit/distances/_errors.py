"""Errors of motions as a function of redshift alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from fit.distances._curve import LogCurve, curve_basis
from fit.distances._density import EDGES
from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray


@dataclass(frozen=True, eq=False)
class ErrorsByRedshift(InNotebook):
    """The mean variance of motions, a smooth function of redshift.

    Weights by a source's own error, which follows its magnitude, tell near sources from far ones of the same
    redshift. Where magnitudes are not known, only weights that depend on the redshift alone are unbiased. With the
    mean variance of its neighbours for each source the covariance of a fit is right on average.

    Attributes
    ----------
    curve : LogCurve
        From ln z to the logarithm of the variance [(µas/yr)²]
    """

    curve: LogCurve

    def at(self, redshift: FloatArray) -> FloatArray:
        """The mean variance at redshifts. [(µas/yr)²]"""
        return np.exp(self.curve(np.log(redshift)))


def variance_sums(redshift: FloatArray, sigma: FloatArray) -> FloatArray:
    """Sources and the sum of their mean variances by redshift, (2, k), which adds over parts."""
    x = np.log(redshift)
    return np.stack([np.histogram(x, EDGES)[0], np.histogram(x, EDGES, weights=np.mean(sigma**2, 0))[0]])


def errors_by_redshift(sums: FloatArray, knots: int = 6) -> ErrorsByRedshift:
    """The curve whose mean is that of the variances, everywhere: they are taken as exponentially distributed about it."""
    held = sums[0] > 0
    counts, totals = sums[:, held]
    x = (EDGES[1:] + EDGES[:-1])[held] / 2
    places = np.linspace(x[0], max(x[-1], x[0] + 0.1), knots)
    basis, n, scale = curve_basis(places, x), counts.sum(), totals.sum() / counts.sum()
    bends = np.diff(np.eye(knots), 2, axis=0)

    def misfit(theta):
        log = basis @ theta
        part = totals / scale * np.exp(-log)
        bent = bends @ theta
        value = np.sum(part + counts * log) / n + 1e-4 * bent @ bent
        return value, basis.T @ (counts - part) / n + 2e-4 * bends.T @ bent

    found = minimize(misfit, np.zeros(knots), jac=True, method="BFGS", options={"gtol": 1e-7}).x
    return ErrorsByRedshift(LogCurve(places, found + np.log(scale)))
