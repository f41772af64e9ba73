"""The likelihood of the secular parallax, compressed: Gaussian in u = v H0/H_ref, smooth in all else.

For given spread s = σ_pec H0/H_ref and excess noise x the data enter through the normal equations
of (u, ã[, ω]) alone, from which ã and ω are marginalised exactly. What is left,

    log L = c(s, x) − (u − û)ᵀ M (u − û)/2,

is tabulated at Chebyshev nodes of asinh(s) and asinh(x) and interpolated; the nodes are doubled
until the table agrees with sums made between them. A sample then costs microseconds, however many the sources.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.polynomial import chebyshev

from fit.secular_parallax import OMEGA, A, ParallaxEquations, ParallaxParts, ParallaxSums, U, check_determined
from vsh.errors import ConvergenceError, ParameterError
from vsh.types import FloatArray
from vsh.vector import Vector

_UPPER = np.triu_indices(3)
_MOST_NODES = 129


@dataclass(frozen=True, eq=False)
class Axis:
    """Chebyshev nodes in asinh(value/scale); a single one where low = high."""

    low: float
    high: float
    scale: float
    count: int

    @property
    def nodes(self) -> FloatArray:
        """Chebyshev nodes between low and high, (k,)."""
        if self.count == 1:
            return np.array([self.low])
        return self._value(np.cos(np.pi * (np.arange(self.count) + 0.5) / self.count))

    def basis(self, value: FloatArray) -> FloatArray:
        """Chebyshev polynomials at values inside the limits, (n, count).

        Parameters
        ----------
        value : (n,) array
            On this axis.
        """
        if self.count == 1:
            return np.ones((value.size, 1))
        a, b = self._ends
        return chebyshev.chebvander((2 * np.arcsinh(value / self.scale) - a - b) / (b - a), self.count - 1)

    def to_coefficients(self, table: FloatArray, axis: int) -> FloatArray:
        """From values at the nodes, along one axis of a table, to Chebyshev coefficients.

        Parameters
        ----------
        table : array
            Values at the nodes.
        axis : int
            Of the table.
        """
        vander = self.basis(self.nodes)
        return np.moveaxis(np.tensordot(np.linalg.inv(vander), table, (1, axis)), 0, axis)

    def finer(self) -> Axis:
        """An axis with more nodes."""
        return Axis(self.low, self.high, self.scale, 2 * self.count if self.count > 1 else 1)

    def at(self, fraction: FloatArray) -> FloatArray:
        """Values at fractions of the way from low to high.

        Parameters
        ----------
        fraction : (n,) array
            Of the way from low to high.
        """
        return self._value(2 * np.asarray(fraction) - 1) if self.count > 1 else np.full(len(fraction), self.low)

    @property
    def _ends(self):
        return np.arcsinh(self.low / self.scale), np.arcsinh(self.high / self.scale)

    def _value(self, t):
        a, b = self._ends
        return np.clip(self.scale * np.sinh((t * (b - a) + a + b) / 2), self.low, self.high)


@dataclass(frozen=True, eq=False)
class CompressedLikelihood:
    """The tabulated likelihood.

    Attributes
    ----------
    spread, excess_noise : Axis
    coefficients : (f, n_s, n_x) array
        Chebyshev coefficients of c, û, M, and of ã's mean at
        u = 0, slope and covariance given u.
    hubble : float
        H_ref [km/s/Mpc]
    frame : str
    """

    spread: Axis
    excess_noise: Axis
    coefficients: FloatArray
    hubble: float
    frame: str

    def __call__(self, spread: FloatArray, excess_noise: FloatArray) -> Any:
        """c (n,), û (n, 3), M (n, 3, 3) at (n,) spreads and excess noises, inside the limits."""
        c, peak, matrix = np.split(self._at(spread, excess_noise, slice(0, 10)), [1, 4], axis=1)
        return c[:, 0], peak, _symmetric(matrix)

    def acceleration(
        self, spread: FloatArray, excess_noise: FloatArray, u: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 3) and covariance (n, 3, 3) of ã, given all the rest.

        Parameters
        ----------
        spread : (n,) array
            s. [km/s]
        excess_noise : array
            Noise beyond the catalogue's. [µas/yr]
        u : (n, 3) array
            u. [km/s]

        Returns
        -------
        tuple[array, array]
        """
        mean, slope, covariance = np.split(self._at(spread, excess_noise, slice(10, 28)), [3, 12], axis=1)
        return mean + np.einsum("nij,nj->ni", slope.reshape(-1, 3, 3), u), _symmetric(covariance)

    def _at(self, spread, excess_noise, which):
        half = np.tensordot(self.excess_noise.basis(np.asarray(excess_noise)), self.coefficients[which], (1, 2))
        return np.einsum("ns,nfs->nf", self.spread.basis(np.asarray(spread)), half)


def compress_likelihood(
    rows: ParallaxEquations | ParallaxParts,
    spread: tuple[float, float] = (0.0, 0.0),
    excess_noise: tuple[float, float] = (0.0, 0.0),
    spin: Literal["free"] | Vector | None = None,
    *,
    accuracy: float = 1e-5,
    threads: int | None = None,
) -> CompressedLikelihood:
    """Tabulate the likelihood between limits.

    Parameters
    ----------
    rows : ParallaxEquations or ParallaxParts
        Its equations.
    spread, excess_noise : pairs of float
        Limits of s [km/s] and x [µas/yr]
    spin : None, "free" or Vector
        As for `fit.secular_parallax.observer_velocity`, but that a Vector's
        covariance is a prior.
    accuracy : float
        Of log L near its largest value; far below it, 1 % of the depth.
    threads : int, optional
        How many; one a core unless given.

    Raises
    ------
    DegeneracyError
        If the sources cannot tell the velocity from the acceleration.
    ConvergenceError
        If the table does not settle.
    """
    scale = max(np.sqrt(rows.smallest_variance) / rows.largest_rate, 1e-6 * max(spread[1], 1e-30))
    axes = [
        Axis(*spread, scale, 1 if spread[0] == spread[1] else 12),
        Axis(*excess_noise, float(np.sqrt(rows.smallest_variance)), 1 if excess_noise[0] == excess_noise[1] else 12),
    ]
    _check(rows, spread[1], excess_noise[1], spin, threads)
    for i in (0, 1):  # each axis along the sharp edge of the other
        edge = [Axis(axis.low, axis.low, axis.scale, 1) for axis in axes]
        while axes[i].count > 1:
            edge[i] = axes[i]
            if _error(_table(rows, edge, spin, threads), rows, spin, threads) < accuracy:
                break
            axes[i] = _finer(axes[i])
    while True:
        table = _table(rows, axes, spin, threads)
        if max(axis.count for axis in axes) == 1 or _error(table, rows, spin, threads) < accuracy:
            return table
        axes = [_finer(axis) for axis in axes]


def _finer(axis):
    if axis.count > _MOST_NODES:
        raise ConvergenceError("the likelihood is too rough to be tabulated: narrow the priors")
    return axis.finer()


def _table(rows, axes, spin, threads):
    s, x = np.meshgrid(axes[0].nodes, axes[1].nodes, indexing="ij")
    values = marginalise(rows.sums(s, x, threads=threads), spin, rows.frame)
    for axis, each in enumerate(axes):
        values = each.to_coefficients(values, axis + 1)
    return CompressedLikelihood(*axes, values, rows.hubble, rows.frame)


def marginalise(sums: ParallaxSums, spin: Literal["free"] | Vector | None, frame: str) -> Any:
    """The functions that are tabulated, (28, …), from normal equations, (…, 9, 9).

    Parameters
    ----------
    sums : ParallaxSums
        Of a catalogue.
    spin : None, "free" or Vector
        As in `Priors`. [µas/yr]
    frame : str
        "icrs", "galactic" or "ecliptic".

    Raises
    ------
    ParameterError
        If the spin is none of these.
    """
    matrix, rhs, chi2 = sums.matrix, sums.rhs, sums.chi2_null
    rest = list(range(A.start, A.stop))
    if isinstance(spin, Vector):
        spin = spin.to_frame(frame)
        if spin.covariance.any():
            matrix, rhs = matrix.copy(), rhs.copy()
            weight = np.linalg.inv(spin.covariance)
            matrix[..., OMEGA, OMEGA] += weight
            rhs[..., OMEGA] += weight @ spin.value
            chi2 = chi2 + spin.value @ weight @ spin.value
            rest += range(OMEGA.start, OMEGA.stop)
        else:
            chi2 = chi2 - 2 * rhs[..., OMEGA] @ spin.value + spin.value @ matrix[..., OMEGA, OMEGA] @ spin.value
            rhs = rhs - matrix[..., OMEGA] @ spin.value
    elif isinstance(spin, str) and spin == "free":
        rest += range(OMEGA.start, OMEGA.stop)
    elif spin is not None:
        raise ParameterError(f"spin is None, 'free' or a Vector, not {spin!r}")
    n_aa, n_au = matrix[..., rest, :][..., rest], matrix[..., rest, U]
    inverse = np.linalg.inv(n_aa)
    slope = -inverse @ n_au
    mean = _times(inverse, rhs[..., rest])
    m = matrix[..., U, U] + np.swapaxes(n_au, -1, -2) @ slope
    b = rhs[..., U] + _times(np.swapaxes(slope, -1, -2), rhs[..., rest])
    peak = np.linalg.solve(m, b[..., None])[..., 0]
    least = chi2 - np.sum(rhs[..., rest] * mean, -1) - np.sum(b * peak, -1)
    c = -(least + sums.logdet + np.linalg.slogdet(n_aa)[1]) / 2
    packed = [c[..., None], peak, m[..., _UPPER[0], _UPPER[1]], mean[..., :3]]
    packed += [slope[..., :3, :].reshape(*c.shape, 9), inverse[..., :3, :3][..., _UPPER[0], _UPPER[1]]]
    return np.moveaxis(np.concatenate(packed, axis=-1), -1, 0)


def _check(rows, spread, excess_noise, spin, threads):
    keep = slice(0, 9 if spin is not None else 6)
    matrix = rows.sums(spread, excess_noise, threads=threads).matrix[keep, keep]
    names = ["v_x", "v_y", "v_z", "a_x", "a_y", "a_z", "omega_x", "omega_y", "omega_z"][keep]
    check_determined(matrix, names, rows.n_data // 2)


def _error(table, rows, spin, threads, points=24):
    """The largest error of log L near its maximum, at points between the nodes, against the sums themselves."""
    t = (np.arange(points) + 0.5) / points
    s = table.spread.at(t)
    x = table.excess_noise.at((t * 0.6180339887 * points) % 1)  # all over the square, and the same every time
    exact = marginalise(rows.sums(s, x, threads=threads), spin, rows.frame)
    c0, peak0, m0 = exact[0], exact[1:4].T, _symmetric(exact[4:10].T)
    c1, peak1, m1 = table(s, x)
    depth = 1 + 0.01 * (c0.max() - c0)
    shift = peak0 - peak1
    moved = np.sqrt(np.abs(np.einsum("ni,nij,nj->n", shift, m0, shift)))
    turned = np.abs(m0 - m1).max((1, 2)) / np.abs(m0).max((1, 2))
    return max((np.abs(c0 - c1) / depth).max(), (moved / depth).max(), (turned / depth).max())


def _times(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def _symmetric(packed):
    full = np.empty((len(packed), 3, 3))
    full[:, _UPPER[0], _UPPER[1]] = packed
    full[:, _UPPER[1], _UPPER[0]] = packed
    return full
