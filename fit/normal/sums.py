"""Sums over sources: three ways to the same normal equations, and the sandwich of residuals.

The design matrix, a block of sources at a time, is the definition: exact to rounding at any degree, and the reference
for the faster ways. The sums stay in one thread: a block takes some microseconds a step, and threads lose more at
handing the interpreter round than they gain (docs/large_catalogues.md).

From a few thousand sources on, moments of the weights are faster. A source's inverse covariance [[a, c], [c, b]] enters
N in products of two harmonics, which are trigonometric polynomials of degree 2L in α and in δ. So N needs of the
catalogue no more than the Fourier moments of a, b and c to that degree,

    F(M, n) = Σ w e^{−i(Mα + nδ)},   |M|, |n| ≤ 2L,

and b those of the weighted motions to degree L. The moments are the only sums over sources.

Longitude by longitude they are put back on 2L + 1 rings of latitude: the rings of a grid of 4L + 2 points around a
whole meridian, of which the far half, where both e_α and e_δ have turned over, falls on the near one at α + π. On the
rings N is a product of small matrices, one for each pair of orders, since Σ w cos mα cos m'α and its like are moments
of M = m ± m'.

Σ Aᵀ X A for any symmetric 2 × 2 matrix X at each source is a normal matrix with X for the weights. The covariance of an
estimate whose score is Σ Aᵀ ψ and whose slope is H is then H⁻¹ (Σ Aᵀ ψψᵀ A) H⁻¹ (Huber 1967; White 1980, Econometrica
48, 817), whatever the errors are at whatever place.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce
from typing import Any

import numpy as np

from vsh.basis import harmonics, scalar_harmonics, toroidal_harmonics
from vsh.field import Field, multiply_weights
from vsh.io.parts import Parts, add_sums
from vsh.modes import Mode, Modes, ScalarModes
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ComplexArray, FloatArray


def sum_by_design_matrix(field: Any, modes: Modes) -> tuple[FloatArray, FloatArray, float]:
    """N, b and Σ yᵀ C⁻¹ y of a field: what `fit.normal_equations` adds up."""
    p = len(modes)
    # Enough sources to keep NumPy busy, and a whitened basis of a few MiB, which stays in the cache.
    size = max(256, min(_SMALL_BLOCK, 2**19 // p))
    block_sums = map_blocks(lambda block: _sum_equations(field[block], modes), len(field), size, 1, "normal equations")
    return reduce(add_sums, block_sums, (np.zeros((p, p)), np.zeros(p), 0.0))


def _sum_equations(field, modes):
    """Sum N, b and Σ yᵀ C⁻¹ y of a few sources, from the basis in units of each source's error."""
    if isinstance(modes, ScalarModes):
        a, y = scalar_harmonics(field.lon, field.lat, modes.lmax) / field.sigma, field.values / field.sigma
        return a @ a.T, a @ y, float(y @ y)
    s1, s2 = field.sigma
    root = np.sqrt(1 - field.rho**2)
    # L⁻¹ with L Lᵀ = C: rows (east, 0) and (mix, north).
    east, north, mix = 1 / s1, 1 / (s2 * root), -field.rho / (s1 * root)

    toroidal = toroidal_harmonics(field.lon, field.lat, modes.lmax)
    t_east, t_north = toroidal[:, 0], toroidal[:, 1]
    half, n = t_east.shape
    a = np.empty((2 * half, 2, n))
    np.multiply(t_east, east, out=a[:half, 0])
    np.multiply(t_north, north, out=a[:half, 1])
    a[:half, 1] += t_east * mix
    # S is T turned by +90°: (e, n) -> (-n, e).
    np.multiply(t_north, -east, out=a[half:, 0])
    np.multiply(t_east, north, out=a[half:, 1])
    a[half:, 1] -= t_north * mix

    a = a.reshape(2 * half, 2 * n)
    y = np.concatenate([field.motion[0] * east, field.motion[0] * mix + field.motion[1] * north])
    return a @ a.T, a @ y, float(y @ y)


def design_matrix_limit(modes: Modes) -> int:
    """The number of sources up to which the direct sum is the faster one, as measured (docs/large_catalogues.md)."""
    return sys.maxsize if modes.lmax <= 2 else max(1000, 2**20 // modes.lmax**3)


#: Sources in a block of moments, and in one whose numbers stay in the cache.
BLOCK, _SMALL_BLOCK = 2**16, 2**13


def slice_blocks(n: int) -> list[slice]:
    """Slice n sources into blocks of so many that what is computed of them stays in the cache."""
    return [slice(start, min(start + _SMALL_BLOCK, n)) for start in range(0, n, _SMALL_BLOCK)]


def sum_by_moments(field: Any, modes: Modes, threads: int | None = None) -> tuple[FloatArray, FloatArray, float]:
    """N, b and Σ yᵀ C⁻¹ y of a field: what `fit.normal_equations` adds up, at any degree."""
    weights, motions, chi2_null = sum_fourier_moments(field, modes.lmax, threads)
    rings = make_rings(modes)
    return rings.matrix(weights), rings.rhs(motions), chi2_null


def make_rings(modes: Modes) -> Rings:
    """Make the rings on which moments for these modes are put back."""
    return (ScalarRings if isinstance(modes, ScalarModes) else Rings)(modes.lmax)


def sum_fourier_moments(field: Any, lmax: int, threads: int | None = None) -> tuple[ComplexArray, ComplexArray, float]:
    """All that a fit to degree L needs of the sources: sums over them, which add."""
    n = max(len(field), 1)  # no source is a block, too
    block_moments = map_blocks(lambda part: _compute_moments(field[part], lmax), n, BLOCK, threads, "normal equations")
    zero: Any = 0, 0, 0.0
    weights, motions, chi2_null = reduce(add_sums, block_moments, zero)
    return weights, motions, float(chi2_null)


def _compute_moments(field, lmax):
    """Compute Fourier moments of a, b, c for 0 ≤ M ≤ 2L, of the motions for 0 ≤ M ≤ L; and χ²."""
    from vsh.transform import fourier_moments

    weights = field.weights
    motions = multiply_weights(weights, field.data)
    moments = fourier_moments(field.lon, field.lat, np.concatenate([weights, motions]), 2 * lmax)
    zero_order, window = 2 * lmax, slice(lmax, 3 * lmax + 1)
    motion_moments = moments[len(weights) :, zero_order : zero_order + lmax + 1, window]
    return moments[: len(weights), zero_order:], motion_moments, np.vdot(motions, field.data)


class Rings:
    """The 2L + 1 rings of latitude on which the moments are put back."""

    modes_class: type[Modes] = Modes

    def __init__(self, lmax: int) -> None:
        modes, n_rings = self.modes_class(lmax), 2 * lmax + 1
        self.lmax, self.size = lmax, len(modes) // len(modes.kinds)
        self.lat = -np.pi / 2 + (np.arange(n_rings) + 0.5) * np.pi / n_rings
        degrees_and_orders = [(l, m) for m in range(lmax + 1) for l in range(max(m, modes.lowest), lmax + 1)]
        self.m = np.array([m for _, m in degrees_and_orders])
        self.re = np.array([modes.index(Mode(modes.kinds[0], l, m)) for l, m in degrees_and_orders])
        self.im = self.re + 1  # where m > 0
        self.b, self.a = self.harmonics(np.zeros(n_rings))

    def harmonics(self, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
        """B and A of the harmonics at α = 0: T_lm = (B cos mα, A sin mα) and (−B sin mα, A cos mα)."""
        toroidal = toroidal_harmonics(lon, self.lat, self.lmax)
        sine_part = toroidal[np.minimum(self.im, len(toroidal) - 1), 1]
        return toroidal[self.re, 0], np.where(self.m[:, None] > 0, sine_part, 0.0)

    def spectra(self, moments: ComplexArray, turns_over: bool) -> ComplexArray:
        """Σ w e^{−iMα} on each ring, (k, M, ring), from the Fourier moments in δ.

        A function that goes with e^{iMα} is even or odd about the pole like M, or unlike M
        where it is a component of a vector, which `turns_over` there.
        """
        max_order = moments.shape[-1] // 2
        n = np.arange(-max_order, max_order + 1)[:, None]
        near_half = np.exp(1j * n * self.lat) / (4 * self.lmax + 2)
        far_half = (-1.0) ** n * np.conj(near_half)
        sign = (-1.0) ** np.arange(moments.shape[1]) * (-1 if turns_over else 1)
        return moments @ near_half + sign[:, None] * (moments @ far_half)

    def on_grid(self, weights: ComplexArray) -> FloatArray:
        """a, b, c on a grid of 2L + 1 rings by 4L + 2 longitudes from α = 0, (3, 2L + 1, 4L + 2).

        The grid with these weights, some of them negative, has the normal matrix of the catalogue.
        """
        spectra = np.swapaxes(self.spectra(weights, turns_over=False), 1, 2)
        return np.fft.irfft(spectra, 4 * self.lmax + 2)

    def matrix(self, weights: ComplexArray) -> FloatArray:
        """N from the moments of a, b, c."""
        a, b, c = self.spectra(weights, turns_over=False)
        # S is T turned by +90°, J = [[0, −1], [1, 0]]: N_SS has Jᵀ W J in place of W, N_TS has W J.
        tt = self.product_matrix(a, c, c, b)
        ss = self.product_matrix(b, -c, -c, a)
        ts = self.product_matrix(c, -a, b, -c)
        return np.block([[tt, ts], [ts.T, ss]])

    def rhs(self, motions: ComplexArray) -> FloatArray:
        """b from the moments of the weighted motions."""
        east, north = (z[self.m] for z in self.spectra(motions, turns_over=True))
        rhs = np.zeros((2, self.size))
        is_positive = self.m > 0
        for kind_rhs, (e, n) in zip(rhs, ((east, north), (north, -east)), strict=True):  # S·z = T·(Jᵀz)
            kind_rhs[self.re] = np.sum(self.b * e.real - self.a * n.imag, axis=1)
            kind_rhs[self.im[is_positive]] = np.sum(self.b * e.imag + self.a * n.real, axis=1)[is_positive]
        return rhs.ravel()

    def product_matrix(self, ee: Any, en: Any, ne: Any, nn: Any) -> FloatArray:
        """Σ T_iᵀ W T_j for weights W = [[ee, en], [ne, nn]] on the rings, in the order of the modes."""
        spectra = np.stack([ee, en, ne, nn])
        real, sine = spectra.real, -spectra.imag  # Σ w cos Mα, Σ w sin Mα
        matrix = np.zeros((self.size, self.size))
        for m in range(self.lmax + 1):
            is_order = self.m == m
            basis = np.concatenate([self.b[is_order], self.a[is_order]], axis=1)
            plus, minus = m + self.m, np.abs(m - self.m)
            sign = np.sign(m - self.m)[:, None]
            c_plus, c_minus = real[:, plus], real[:, minus]
            s_plus, s_minus = sine[:, plus], sign * sine[:, minus]
            cc, ss = (c_minus + c_plus) / 2, (c_minus - c_plus) / 2
            sc, cs = (s_plus + s_minus) / 2, (s_plus - s_minus) / 2  # first of m, then of m'

            def multiply_basis(on_b, on_a, left=basis):
                """[B A] · [on_b; on_a], both (pairs, rings) on the right."""
                return left @ np.concatenate([on_b, on_a], axis=1).T

            b, a = self.b, self.a
            blocks = {
                ("re", "re"): multiply_basis(cc[0] * b + cs[1] * a, sc[2] * b + ss[3] * a),
                ("re", "im"): multiply_basis(cc[1] * a - cs[0] * b, sc[3] * a - ss[2] * b),
                ("im", "re"): multiply_basis(-sc[0] * b - ss[1] * a, cc[2] * b + cs[3] * a),
                ("im", "im"): multiply_basis(ss[0] * b - sc[1] * a, cc[3] * a - cs[2] * b),
            }
            for (i, j), block in blocks.items():
                if i == "im" and m == 0:
                    continue
                rows, columns = (self.re if i == "re" else self.im)[is_order], self.re if j == "re" else self.im
                selection = slice(None) if j == "re" else self.m > 0
                matrix[np.ix_(rows, columns[selection])] = block[:, selection]
        return matrix


class ScalarRings(Rings):
    """Rings for scalar fields: their harmonics are those of an east component alone, B cos mα and −B sin mα."""

    modes_class = ScalarModes

    def harmonics(self, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
        """B of the harmonics at α = 0, and A, which is zero."""
        b = scalar_harmonics(lon, self.lat, self.lmax)[self.re]
        return b, np.zeros_like(b)

    def matrix(self, weights: ComplexArray) -> FloatArray:
        """N from the moments of the weights."""
        (w,) = self.spectra(weights, turns_over=False)
        return self.product_matrix(w, 0 * w, 0 * w, 0 * w)

    def rhs(self, motions: ComplexArray) -> FloatArray:
        """b from the moments of the weighted values."""
        values = self.spectra(motions, turns_over=False)[0][self.m]
        rhs, is_positive = np.zeros(self.size), self.m > 0
        rhs[self.re] = np.sum(self.b * values.real, axis=1)
        rhs[self.im[is_positive]] = np.sum(self.b * values.imag, axis=1)[is_positive]
        return rhs


#: Work up to which the leverage of each source is computed exactly: sources times coefficients squared.
EXACT_LEVERAGE_WORK = 2e9
#: Relative accuracy of moments that make errors.
_MOMENT_ACCURACY = 1e-9
#: Mean leverage below which it need not be: variances change by 1.5 times as much at most, errors by three quarters.
_NEGLIGIBLE_LEVERAGE = 1e-3


def _has_exact_leverages(n_sources, modes):
    """Return whether leverages are computed source by source."""
    p = len(modes)
    return n_sources * p * p <= EXACT_LEVERAGE_WORK and p > _NEGLIGIBLE_LEVERAGE * modes.components * n_sources


@dataclass(frozen=True, eq=False)
class _WeightedSources:
    """Sources with matrices in place of errors: what the sums look at of a field."""

    lon: FloatArray
    lat: FloatArray
    weights: FloatArray
    data: FloatArray

    def __len__(self):
        return self.lon.size

    def __getitem__(self, index):
        return _WeightedSources(self.lon[index], self.lat[index], self.weights[:, index], self.data[:, index])


def weighted_sums(
    field: Field, weights: FloatArray, modes: Modes, threads: int | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Σ Aᵀ X A, Σ Aᵀ X y and Σ yᵀ X y with any symmetric X = [[a, c], [c, b]] at each source."""
    sources = _WeightedSources(field.lon, field.lat, np.asarray(weights, float), field.data)
    if len(sources) > design_matrix_limit(modes):
        return sum_by_moments(sources, modes, threads)

    def sum_chunk(chunk):
        basis, subset = harmonics(field.lon[chunk], field.lat[chunk], modes), sources[chunk]
        weighted_basis = multiply_weights(subset.weights, basis).reshape(len(modes), -1)
        chi2 = np.vdot(subset.data, multiply_weights(subset.weights, subset.data))
        return basis.reshape(len(modes), -1) @ weighted_basis.T, weighted_basis @ subset.data.ravel(), float(chi2)

    return reduce(add_sums, map_blocks(sum_chunk, len(sources), max(64, 2**21 // len(modes)), threads))


def weighted_matrix(field: Field, weights: FloatArray, modes: Modes, threads: int | None = None) -> FloatArray:
    """Σ Aᵀ [[a, c], [c, b]] A over the sources, (p, p)."""
    return weighted_sums(field, weights, modes, threads)[0]


def leverage(
    field: Field,
    modes: Modes,
    inverse: FloatArray,
    factors: FloatArray | float = 1.0,
    *,
    total: tuple[int, float] | None = None,
) -> FloatArray:
    """Leverage of each source on its own fitted motion: between 0 and 1, p/2n on average (p/n of scalars).

    Returns
    -------
    (1 + blocks, n) or (1, n) array
        By all coefficients together, and by those of each kind and degree with the others free.

    Notes
    -----
    Exact for small problems. For large ones p tr W/(2 Σ tr W), which is exact on a uniform sky by the addition theorem,
    of all coefficients alone.
    """
    p = len(modes)
    weights, components = field.weights * factors, field.components
    traces = weights[:components].sum(0)
    n_sources, total_trace = (len(field), traces.sum()) if total is None else total
    if not _has_exact_leverages(n_sources, modes):
        return _approximate_leverages(traces, p, components, total_trace)[None]

    blocks = [slice(0, p), *modes.blocks.values()]
    root = np.concatenate([np.linalg.solve(np.linalg.cholesky(inverse[rows, rows]), inverse[rows]) for rows in blocks])
    starts = np.cumsum([0, *(rows.stop - rows.start for rows in blocks[:-1])])
    pairs = ((0, 0), (1, 1), (0, 1))[: len(weights)]

    def compute_chunk(chunk):
        basis = harmonics(field.lon[chunk], field.lat[chunk], modes)
        whitened = (root @ basis.reshape(p, -1)).reshape(len(root), *basis.shape[1:])
        # The symmetric matrices of a source's motion: their trace with its weight, where c counts twice.
        products = [(1 + (i != j)) * np.add.reduceat(whitened[:, i] * whitened[:, j], starts) for i, j in pairs]
        return np.einsum("kn,kbn->bn", weights[:, chunk], products) / components

    leverages = np.concatenate(list(map_blocks(compute_chunk, len(field), max(64, 2**17 // p), 1)), axis=1)
    return np.clip(leverages, 0.0, 0.9)


def _approximate_leverages(trace, p, components, total_trace):
    """Approximate the leverages by the sources' weights alone."""
    return np.minimum(p * trace / total_trace / components, 0.9)


def compute_score_products(field: Field, residual: FloatArray, factors: FloatArray) -> FloatArray:
    """Compute factors² C⁻¹ΔΔᵀC⁻¹ of each source, (3, n), or (1, n) of scalars: the scatter of ψ = factors C⁻¹Δ."""
    score = multiply_weights(field.weights, residual)
    if len(score) == 1:
        return score**2 * factors**2
    east, north = score
    return np.stack([east * east, north * north, east * north]) * factors**2


def sandwich(
    sky: Parts,
    scores: Callable[[Field], tuple[FloatArray, FloatArray, FloatArray]],
    modes: Modes,
    *,
    power: float = 0.75,
    words: str = "errors",
    total: tuple[int, float] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """H⁻¹ M H⁻¹, (p, p): the covariance of a fit whose scores are Σ Aᵀ u C⁻¹Δ; and its degrees of freedom.

    Those of all coefficients come first, then those of each kind and degree: on an uneven sky a few sources may decide
    on a vector. Large problems, whose leverages are approximate, have the first alone.

    Where `total`, the number of sources and Σ u tr W, is known, one pass over many sources gives both H and M.

    M is a sum of the scores' outer products. Its degrees of freedom are those of the Wishart matrix whose elements
    scatter as much, for Gaussian scores p(p + 1)/Σ [(tr H_i)² + tr H_i²], where H_i is the share of source i in the
    information (Zhang 2012, J. Agric. Biol. Environ. Stat. 17, 652): (k² + k) h_i² for a leverage h_i in k components.
    """
    if total is not None and not _has_exact_leverages(total[0], modes):
        sum_field = partial(_sum_slopes_and_products, scores=scores, modes=modes, total=total, power=power)
        score_sums = sky.sum(sum_field, roles=(), words=words)
        inverse_slope, n_sources = np.linalg.inv(score_sums["slope"]), total[0]
    else:
        # The fitted matrix is for exact leverages, which large problems do without.
        has_exact = sky.in_memory is None or _has_exact_leverages(len(sky.in_memory), modes)
        sums = sky.sum(partial(_sum_matrices, scores=scores, modes=modes, has_exact=has_exact), roles=(), words=words)
        inverse_slope, n_sources = np.linalg.inv(sums["slope"]), sums["sources"]
        inverse = np.linalg.inv(sums["fitted"]) if has_exact else inverse_slope
        total = (n_sources, sums["trace"])
        sum_field = partial(_sum_score_products, scores=scores, modes=modes, inverse=inverse, total=total, power=power)
        score_sums = sky.sum(sum_field, roles=(), words=words)
    covariance = inverse_slope @ score_sums["matrix"] @ inverse_slope
    residual_dof = modes.components * n_sources - len(modes)  # by which residuals can differ
    return (covariance + covariance.T) / 2, np.minimum(score_dof(score_sums["squares"], modes), residual_dof)


def score_dof(squares: FloatArray, modes: Modes) -> FloatArray:
    """Degrees of freedom of the scores' outer products, by Σh² of each row of `leverage` (`sandwich`)."""
    sizes, k = np.array([len(modes), *(2 * l + 1 for _, l in modes.blocks)])[: len(squares)], modes.components
    return np.asarray(sizes * (sizes + 1) / ((k**2 + k) * squares))


def _sum_matrices(field, scores, modes, has_exact):
    """Sum over some sources: the matrices with weights u and with their slopes, Σ u tr W, and how many they are."""
    _, u, slopes = scores(field)
    return {
        "fitted": weighted_matrix(field, field.weights * u, modes) if has_exact else 0.0,
        "slope": weighted_matrix(field, field.weights * slopes, modes),
        "trace": float(np.sum(field.information * u)),
        "sources": len(field),
    }


def _sum_score_products(field, scores, modes, inverse, total, power):
    """Sum AᵀψψᵀA and h² over some sources."""
    residual, u, _ = scores(field)
    leverages = leverage(field, modes, inverse, u, total=total)
    products = compute_score_products(field, residual, u / (1 - leverages[0]) ** power)
    return {"matrix": weighted_matrix(field, products, modes), "squares": np.sum(leverages**2, axis=1)}


def _sum_slopes_and_products(field, scores, modes, total, power):
    """Σ Aᵀ u'W A and Σ AᵀψψᵀA of some of many sources, and Σ h²: from moments of both, summed together."""
    from vsh.transform import fourier_moments

    residual, u, slopes = scores(field)

    def sum_block(block):
        chunk, squared_leverage, half = field[block], 0.0, 1 if field.components == 1 else 3
        planes = np.empty((2 * half, len(chunk)))
        for piece in slice_blocks(len(chunk)):
            subset, rows = chunk[piece], slice(block.start + piece.start, block.start + piece.stop)
            leverages = _approximate_leverages(subset.information * u[rows], len(modes), subset.components, total[1])
            planes[:half, piece] = subset.weights * slopes[rows]
            planes[half:, piece] = compute_score_products(subset, residual[:, rows], u[rows] / (1 - leverages) ** power)
            squared_leverage += float(leverages @ leverages)
        moments = fourier_moments(chunk.lon, chunk.lat, planes, 2 * modes.lmax, _MOMENT_ACCURACY)
        return {"moments": moments[:, 2 * modes.lmax :], "squares": np.array([squared_leverage])}

    sums = reduce(add_sums, map_blocks(sum_block, len(field), BLOCK))
    rings = make_rings(modes)
    slope, matrix = (rings.matrix(moments) for moments in np.split(sums.pop("moments"), 2))
    return sums | {"slope": slope, "matrix": matrix}
