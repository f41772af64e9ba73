"""The likelihood of the secular parallax, compressed: Gaussian in u = v H0/H_ref, smooth in all else.

For given spread s = σ_pec H0/H_ref, excess noise x and size q of the flow that galaxies share the data enter through
the normal equations of (u, ã[, ω], flow) alone, from which all but u is marginalised exactly. What is left,

    log L = c(s, x, q) − (u − û)ᵀ M (u − û)/2,

is tabulated at Chebyshev nodes of asinh(s), asinh(x) and asinh(q) and interpolated; the nodes are doubled
until the table agrees with sums made between them. A sample then costs microseconds, however many the sources.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fit.sampling import Axis
from fit.secular_parallax import (
    OMEGA,
    A,
    ParallaxEquations,
    ParallaxParts,
    ParallaxSums,
    U,
    check_determined,
    with_acceleration,
    with_flow,
    without_flow,
)
from vsh.tools.errors import ConvergenceError, ParameterError
from vsh.tools.types import FloatArray
from vsh.vector import Vector

_UPPER = np.triu_indices(3)
_MOST_NODES = 129


@dataclass(frozen=True, eq=False)
class CompressedLikelihood:
    """The tabulated likelihood."""

    axes: tuple[Axis, Axis, Axis]
    coefficients: FloatArray
    hubble: float
    frame: str

    def __call__(self, spreads: FloatArray) -> Any:
        """c (n,), û (n, 3), M (n, 3, 3) at spreads, excess noises and sizes of the flow, inside the limits."""
        c, peak, matrix = np.split(self._at(spreads, slice(0, 10)), [1, 4], axis=1)
        return c[:, 0], peak, _symmetric(matrix)

    def acceleration(self, spreads: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 3) and covariance (n, 3, 3) of ã, given all the rest."""
        mean, slope, covariance = np.split(self._at(spreads, slice(10, 28)), [3, 12], axis=1)
        return mean + np.einsum("nij,nj->ni", slope.reshape(-1, 3, 3), u), _symmetric(covariance)

    def _at(self, spreads, which):
        bases = [axis.basis(np.asarray(value)) for axis, value in zip(self.axes, spreads, strict=True)]
        first = np.tensordot(bases[2], self.coefficients[which], (1, 3))  # (n, f, n_s, n_x)
        second = np.einsum("nx,nfsx->nfs", bases[1], first)
        return np.einsum("ns,nfs->nf", bases[0], second)


@dataclass(frozen=True, eq=False)
class Tabulated:
    """What is tabulated: the functions of s, x and q."""

    rows: ParallaxEquations | ParallaxParts
    spin: Literal["free"] | Vector | None
    acceleration: Vector | None
    threads: int | None

    def at(self, s: FloatArray, x: FloatArray, q: FloatArray) -> FloatArray:
        """The functions, (28, n), at n points: `marginalise` of the sums, flow and acceleration as they are known."""
        pairs, which = np.unique(np.stack([s, x]), axis=1, return_inverse=True)
        sums = with_acceleration(self.rows.sums(*pairs, threads=self.threads), self.acceleration, self.rows.frame)
        if self.rows.modes is None:
            return marginalise(sums, self.spin, self.rows.frame)[:, which.ravel()]
        terms = []
        for pair, size in zip(which.ravel(), q, strict=True):
            one = ParallaxSums(sums.matrix[pair], sums.rhs[pair], sums.chi2_null[pair], sums.logdet[pair], sums.n_data)
            left, _ = without_flow(with_flow(one, 9, size), 9)
            terms.append(marginalise(left, self.spin, self.rows.frame))
        return np.stack(terms, axis=1)


def compress_likelihood(
    rows: ParallaxEquations | ParallaxParts,
    spread: tuple[float, float] = (0.0, 0.0),
    excess_noise: tuple[float, float] = (0.0, 0.0),
    spin: Literal["free"] | Vector | None = None,
    *,
    flow: tuple[float, float] = (1.0, 1.0),
    acceleration: Vector | None = None,
    accuracy: float = 1e-5,
    threads: int | None = None,
) -> CompressedLikelihood:
    """Tabulate the likelihood between limits."""
    scale = max(np.sqrt(rows.smallest_variance) / rows.largest_rate, 1e-6 * max(spread[1], 1e-30))
    noise = float(np.sqrt(rows.smallest_variance))
    limits = ((spread, scale), (excess_noise, noise), (flow, flow[1]))
    axes = [Axis(*pair, size, 1 if pair[0] == pair[1] else 12) for pair, size in limits]
    what = Tabulated(rows, spin, acceleration, threads)
    _check(rows, spread[1], excess_noise[1], spin, threads)
    for i in range(3):  # each axis along the sharp edge of the others
        edge = [Axis(axis.low, axis.low, axis.scale, 1) for axis in axes]
        while axes[i].count > 1:
            edge[i] = axes[i]
            if _error(_table(what, edge), what) < accuracy:
                break
            axes[i] = _finer(axes[i])
    while True:
        table = _table(what, axes)
        if max(axis.count for axis in axes) == 1 or _error(table, what) < accuracy:
            return table
        axes = [_finer(axis) for axis in axes]


def _finer(axis):
    if axis.count > _MOST_NODES:
        raise ConvergenceError("the likelihood is too rough to be tabulated: narrow the priors")
    return axis.finer()


def _table(what, axes):
    nodes = np.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    values = what.at(*(node.ravel() for node in nodes)).reshape(-1, *nodes[0].shape)
    for axis, each in enumerate(axes):
        values = each.to_coefficients(values, axis + 1)
    return CompressedLikelihood(tuple(axes), values, what.rows.hubble, what.rows.frame)


def marginalise(sums: ParallaxSums, spin: Literal["free"] | Vector | None, frame: str) -> Any:
    """The functions that are tabulated, (28, …), from normal equations, (…, 9, 9)."""
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


def _error(table, what, points=24):
    """The largest error of log L near its maximum, at points between the nodes, against the sums themselves."""
    t = (np.arange(points) + 0.5) / points
    golden = 0.6180339887 * points
    fractions = (t, (t * golden) % 1, (t * golden**2) % 1)  # all over the cube, and the same every time
    spreads = np.stack([axis.at(each) for axis, each in zip(table.axes, fractions, strict=True)])
    exact = what.at(*spreads)
    c0, peak0, m0 = exact[0], exact[1:4].T, _symmetric(exact[4:10].T)
    c1, peak1, m1 = table(spreads)
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
