"""Passes over the observations, compiled (numba).

Each pass runs over one part of the transits in one thread, releases the interpreter's lock, and has sums of its
own. If the sums are added in the order of the parts, the result is bit-identical for any number of threads. One pass
can take several vectors, along a last axis of length K. `lengths` is a tuple of K zeros, so that K is known when the
loop is compiled.

The tuple `transits` has the columns of `Scans`, the table of the sources, the spacing of the knots and the middle of
the mission. Indices are unsigned, which avoids the test for negative indices and saves a quarter of the time.
"""

import numpy as np
from numba import njit

from vsh.tools.parallel import compile_loops
from vsh.tools.types import FloatArray

_compile = compile_loops(fastmath={"contract", "reassoc", "nsz"})

_ONE, _TWO, _THREE = np.uintp(1), np.uintp(2), np.uintp(3)


@njit(inline="always")
def _evaluate_splines(f):
    g = 1.0 - f
    return (
        g * g * g / 6.0,
        (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
        (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0,
        f * f * f / 6.0,
    )


@njit(inline="always")
def _compute_scan_axes(s, c, table, q):
    """Compute n and m on the sky, from the scan angle and sin α, cos α, sin δ, cos δ of the source."""
    # Double precision is used from here on, so that the null space is exact.
    sa, ca, sd, cd = np.float64(table[q, 0]), np.float64(table[q, 1]), np.float64(table[q, 2]), np.float64(table[q, 3])
    qx, qy = -sd * ca, -sd * sa
    return (c * sa + s * qx, -c * ca + s * qy, s * cd, -s * sa + c * qx, s * ca + c * qy, c * cd)


@njit(inline="always")
def _unpack_transit(i, first_knot, transits):
    """Source and knot of an observation, its splines, partial derivatives, axes n and m, and weights."""
    source, knot, frac, sin, cos, fal, fac, table, spacing, middle = transits
    q, k = np.uintp(source[i]), np.uintp(knot[i] - first_knot)
    s, c, f = np.float64(sin[i]), np.float64(cos[i]), np.float64(frac[i])
    partials = (s, c, fal[i], fac[i], (knot[i] + f) * spacing - middle)
    return q, k, _evaluate_splines(f), partials, _compute_scan_axes(s, c, table, q), (table[q, 4], table[q, 5])


@njit(inline="always")
def _predict_by_source(x, source, r, partials):
    """Along and across scan by the parameters of a source."""
    s, c, fal, fac, t = partials
    east, north = x[source, 0, r] + t * x[source, 3, r], x[source, 1, r] + t * x[source, 4, r]
    return s * east + c * north + fal * x[source, 2, r], s * north - c * east + fac * x[source, 2, r]


@njit(inline="always")
def _add_source_terms(sources, source, r, partials, along, across):
    s, c, fal, fac, t = partials
    east, north = s * along - c * across, c * along + s * across
    sources[source, 0, r] += east
    sources[source, 1, r] += north
    sources[source, 2, r] += fal * along + fac * across
    sources[source, 3, r] += t * east
    sources[source, 4, r] += t * north


@njit(inline="always")
def _evaluate_spline(h, k, axis, r, b):
    return (
        b[0] * h[k, axis, r] + b[1] * h[k + _ONE, axis, r] + b[2] * h[k + _TWO, axis, r] + b[3] * h[k + _THREE, axis, r]
    )


@njit(inline="always")
def _predict_by_attitude(h, k, r, b, axes):
    """Along and across scan by the coefficients of the attitude."""
    nx, ny, nz, mx, my, mz = axes
    ex, ey, ez = _evaluate_spline(h, k, 0, r, b), _evaluate_spline(h, k, 1, r, b), _evaluate_spline(h, k, 2, r, b)
    return -(nx * ex + ny * ey + nz * ez), mx * ex + my * ey + mz * ez


@njit(inline="always")
def _add_spline_terms(attitude, knot, axis, r, b, g):
    attitude[knot, axis, r] += b[0] * g
    attitude[knot + _ONE, axis, r] += b[1] * g
    attitude[knot + _TWO, axis, r] += b[2] * g
    attitude[knot + _THREE, axis, r] += b[3] * g


@njit(inline="always")
def _add_attitude_terms(attitude, knot, r, b, axes, along, across):
    nx, ny, nz, mx, my, mz = axes
    _add_spline_terms(attitude, knot, 0, r, b, mx * across - nx * along)
    _add_spline_terms(attitude, knot, 1, r, b, my * across - ny * along)
    _add_spline_terms(attitude, knot, 2, r, b, mz * across - nz * along)


@_compile
def add_to_attitude(
    start: int, stop: int, first: int, lengths: tuple, x: FloatArray, attitude: FloatArray, transits: tuple
) -> None:
    """Add Cᵀ x to `attitude`: the terms of the attitude's equations that the source parameters x give."""
    for i in range(np.uintp(start), np.uintp(stop)):
        source, knot, b, partials, axes, weights = _unpack_transit(i, first, transits)
        for r in range(np.uintp(len(lengths))):
            along, across = _predict_by_source(x, source, r, partials)
            _add_attitude_terms(attitude, knot, r, b, axes, weights[0] * along, weights[1] * across)


@_compile
def add_to_sources(start: int, stop: int, lengths: tuple, h: FloatArray, sources: FloatArray, transits: tuple) -> None:
    """Add C h to `sources`: the terms of the sources' equations that the attitude coefficients h give."""
    for i in range(np.uintp(start), np.uintp(stop)):
        source, knot, b, partials, axes, weights = _unpack_transit(i, 0, transits)
        for r in range(np.uintp(len(lengths))):
            along, across = _predict_by_attitude(h, knot, r, b, axes)
            _add_source_terms(sources, source, r, partials, weights[0] * along, weights[1] * across)


@_compile
def predict(
    start: int, stop: int, x: FloatArray, h: FloatArray, along: FloatArray, across: FloatArray, transits: tuple
) -> None:
    """Compute the observations that the parameters x and h predict, and store them in `along` and `across`."""
    for i in range(np.uintp(start), np.uintp(stop)):
        source, knot, b, partials, axes, _ = _unpack_transit(i, 0, transits)
        by_source, by_attitude = _predict_by_source(x, source, 0, partials), _predict_by_attitude(h, knot, 0, b, axes)
        along[i], across[i] = by_source[0] + by_attitude[0], by_source[1] + by_attitude[1]


@_compile
def add_adjoint(
    start: int, stop: int, first: int, observations: tuple, sources: FloatArray, attitude: FloatArray, transits: tuple
) -> None:
    """Apply the weighted transpose of `predict`, and add the result to `sources` and `attitude`."""
    along, across = observations
    for i in range(np.uintp(start), np.uintp(stop)):
        source, knot, b, partials, axes, weights = _unpack_transit(i, first, transits)
        weighted_along, weighted_across = weights[0] * along[i], weights[1] * across[i]
        _add_attitude_terms(attitude, knot, 0, b, axes, weighted_along, weighted_across)
        _add_source_terms(sources, source, 0, partials, weighted_along, weighted_across)


@_compile
def add_blocks(start: int, stop: int, first: int, source_blocks: FloatArray, band: FloatArray, transits: tuple) -> None:
    """Add the lower triangles of the sources' blocks, and the lower band of the attitude's matrix, by columns."""
    along, across, n, m = np.empty(5), np.empty(5), np.empty(3), np.empty(3)
    for i in range(start, stop):
        source, knot, b, (s, c, fal, fac, t), axes, (along_weight, across_weight) = _unpack_transit(i, first, transits)
        block = source_blocks[source]
        along[0], along[1], along[2], along[3], along[4] = s, c, fal, t * s, t * c
        across[0], across[1], across[2], across[3], across[4] = -c, s, fac, -t * c, t * s
        for p in range(5):
            for q in range(p + 1):
                block[p, q] += along_weight * along[p] * along[q] + across_weight * across[p] * across[q]
        n[0], n[1], n[2], m[0], m[1], m[2] = axes
        k = np.intp(knot)
        for p in range(3):
            for q in range(3):
                w = along_weight * n[p] * n[q] + across_weight * m[p] * m[q]
                for u in range(4):
                    for v in range(u + 1):
                        offset = 3 * (u - v) + p - q
                        if offset >= 0:
                            band[3 * (k + v) + q, offset] += b[u] * b[v] * w
