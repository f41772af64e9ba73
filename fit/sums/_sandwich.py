"""Covariances that ask each source how far it lies from the fit, and how much of the fit it makes itself.

Σ Aᵀ X A for any symmetric 2 × 2 matrix X at each source is a normal matrix with X for the weights. The
covariance of an estimate whose score is Σ Aᵀ ψ and whose slope is H is then H⁻¹ (Σ Aᵀ ψψᵀ A) H⁻¹
(Huber 1967; White 1980, Econometrica 48, 817), whatever the errors are at whatever place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from fit.sums._design_matrix import design_matrix_up_to
from fit.sums._rings import compressed_sums
from vsh.basis import harmonics
from vsh.checks.types import FloatArray
from vsh.checks.weighed import weighed
from vsh.field import Field
from vsh.modes import Modes
from vsh.parts import Parts, added
from vsh.system.parallel import map_blocks

#: Work up to which the leverage of each source is computed exactly: sources times coefficients squared.
EXACT = 2e9


@dataclass(frozen=True, eq=False)
class _Weighted:
    """Sources with matrices in place of errors: what the sums look at of a field."""

    lon: FloatArray
    lat: FloatArray
    weights: FloatArray
    data: FloatArray

    def __len__(self):
        return self.lon.size

    def __getitem__(self, part):
        return _Weighted(self.lon[part], self.lat[part], self.weights[:, part], self.data[:, part])


def weighted_sums(
    field: Field, weights: FloatArray, modes: Modes, threads: int | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Σ Aᵀ X A, Σ Aᵀ X y and Σ yᵀ X y with any symmetric X = [[a, c], [c, b]] at each source."""
    sources = _Weighted(field.lon, field.lat, np.asarray(weights, float), field.data)
    if len(sources) > design_matrix_up_to(modes):
        return compressed_sums(sources, modes, threads)

    def block(part):
        basis, some = harmonics(field.lon[part], field.lat[part], modes), sources[part]
        flat = weighed(some.weights, basis).reshape(len(modes), -1)
        square = np.vdot(some.data, weighed(some.weights, some.data))
        return basis.reshape(len(modes), -1) @ flat.T, flat @ some.data.ravel(), float(square)

    return reduce(added, map_blocks(block, len(sources), max(64, 2**21 // len(modes)), threads))


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
    threads: int | None = None,
) -> FloatArray:
    """How much of its own fitted motion each source makes, (n,): between 0 and 1, p/2n on average (p/n of scalars).

    Notes
    -----
    Exact for small problems. For large ones p tr W/(2 Σ tr W), which is exact on a uniform sky by the
    addition theorem.
    """
    p = len(modes)
    weights, components = field.weights * factors, field.components
    trace = weights[:components].sum(0)
    n_sources, whole = (len(field), trace.sum()) if total is None else total
    if n_sources * p * p > EXACT:
        return np.minimum(p * trace / whole / components, 0.9)

    def block(part):
        basis = harmonics(field.lon[part], field.lat[part], modes)
        left = np.tensordot(inverse, basis, 1)
        return np.einsum("pkn,pkn->n", left, weighed(weights[:, part], basis)) / components

    found = np.concatenate(list(map_blocks(block, len(field), max(64, 2**20 // p), threads)))
    return np.clip(found, 0.0, 0.9)


def outer_products(field: Field, residual: FloatArray, factors: FloatArray) -> FloatArray:
    """factors² C⁻¹ΔΔᵀC⁻¹ of each source as (3, n), or (1, n) of scalars: what the scores ψ = factors C⁻¹Δ scatter by."""
    score = weighed(field.weights, residual)
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
) -> FloatArray:
    """H⁻¹ M H⁻¹, (p, p): the covariance of a fit whose scores are Σ Aᵀ u C⁻¹Δ."""
    slopes = sky.sum(partial(_slopes, scores=scores, modes=modes), roles=(), words=words)
    fitted, slope = np.linalg.inv(slopes["fitted"]), np.linalg.inv(slopes["slope"])
    total = (slopes["sources"], slopes["trace"])
    middle = sky.sum(
        partial(_scores, scores=scores, modes=modes, inverse=fitted, total=total, power=power), roles=(), words=words
    )
    covariance = slope @ middle @ slope
    return (covariance + covariance.T) / 2


def _slopes(field, scores, modes):
    """Of some sources: the matrices with weights u and with their slopes, Σ u tr W, and how many they are."""
    _, u, slopes = scores(field)
    return {
        "fitted": weighted_matrix(field, field.weights * u, modes),
        "slope": weighted_matrix(field, field.weights * slopes, modes),
        "trace": float(np.sum(field.information * u)),
        "sources": len(field),
    }


def _scores(field, scores, modes, inverse, total, power):
    """Σ AᵀψψᵀA of some sources."""
    residual, u, _ = scores(field)
    own = leverage(field, modes, inverse, u, total=total)
    return weighted_matrix(field, outer_products(field, residual, u / (1 - own) ** power), modes)
