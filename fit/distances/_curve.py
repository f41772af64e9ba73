"""Smooth curves with a few knots, whose logarithms are fitted to counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from vsh.checks.types import FloatArray


@dataclass(frozen=True, eq=False)
class LogCurve:
    """A natural cubic spline through a few values, straight beyond the outer ones.

    Attributes
    ----------
    knots, values : (k,) arrays
        Rising knots, and the logarithm of the curve there.
    """

    knots: FloatArray
    values: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """The logarithm of the curve."""
        spline = CubicSpline(self.knots, self.values, bc_type="natural")
        ends = self.knots[[0, -1]]
        inside = np.clip(x, *ends)
        slopes = spline(ends, 1)
        return spline(inside) + np.where(x < ends[0], slopes[0], slopes[1]) * (x - inside)


def curve_basis(knots: FloatArray, x: FloatArray) -> FloatArray:
    """What each value at a knot adds to the curve, (n, k)."""
    return np.stack([LogCurve(knots, unit)(x) for unit in np.eye(len(knots))], axis=1)


def fit_log_curve(basis: FloatArray, counts: FloatArray, shares: FloatArray, smooth: float = 1e-3) -> FloatArray:
    """The values at the knots that make counts most probable.

    The chance of a source of group b to be in cell a is shares[b, a] exp(curve) over the sum of those of the group.
    """
    second = np.diff(np.eye(basis.shape[1]), 2, axis=0)
    total = counts.sum()

    def misfit(theta):
        curve = np.exp(basis @ theta - (basis @ theta).max())
        if shares.ndim == 2:  # cells are seen as they are
            norm = shares @ curve
            inner = counts.sum(1) / np.maximum(norm, 1e-300)
            value = np.sum(counts.sum(1) * np.log(np.maximum(norm, 1e-300))) - np.sum(counts.sum(0) * np.log(curve))
            slope = curve * (shares.T @ inner) - counts.sum(0)
        else:  # cells are seen through a kernel
            seen = shares @ curve
            norm = seen.sum(1)
            inner = counts.sum(1) / norm
            value = np.sum(counts.sum(1) * np.log(norm)) - np.sum(counts * np.log(np.maximum(seen, 1e-300)))
            slope = curve * (
                np.einsum("bam,b->m", shares, inner) - np.einsum("bam,ba->m", shares, counts / np.maximum(seen, 1e-300))
            )
        bent = second @ theta
        return (
            value / total + smooth * bent @ bent + 1e-6 * theta.mean() ** 2,
            basis.T @ slope / total + 2 * smooth * second.T @ bent + 2e-6 * theta.mean() / len(theta),
        )

    return minimize(misfit, np.zeros(basis.shape[1]), jac=True, method="BFGS", options={"gtol": 1e-6}).x
