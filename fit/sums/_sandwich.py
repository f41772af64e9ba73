"""Covariances that ask each source how far it lies from the fit, and how much of the fit it makes itself.

Σ Aᵀ X A for any symmetric 2 × 2 matrix X at each source is a normal matrix with X for the weights. The
covariance of an estimate whose score is Σ Aᵀ ψ and whose slope is H is then H⁻¹ (Σ Aᵀ ψψᵀ A) H⁻¹
(Huber 1967; White 1980, Econometrica 48, 817), whatever the errors are at whatever place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.sums._design_matrix import design_matrix_up_to
from fit.sums._rings import Rings, fourier_sums
from vsh.basis import harmonics
from vsh.field import Field
from vsh.modes import Modes
from vsh.system.parallel import map_blocks
from vsh.types import FloatArray

#: Work up to which the leverage of each source is computed exactly: sources times coefficients squared.
EXACT = 2e9


@dataclass(frozen=True, eq=False)
class _Weighted:
    """Sources with matrices in place of errors: what the sums look at of a field."""

    lon: FloatArray
    lat: FloatArray
    weights: FloatArray

    @property
    def motion(self):
        return np.zeros((2, len(self)))

    def __len__(self):
        return self.lon.size

    def __getitem__(self, part):
        return _Weighted(self.lon[part], self.lat[part], self.weights[:, part])


def weighted_matrix(field: Any, weights: FloatArray, modes: Modes, threads: int | None = None) -> FloatArray:
    """Σ Aᵀ [[a, c], [c, b]] A over the sources, (p, p).

    Parameters
    ----------
    field : Field
        Only its positions count.
    weights : (3, n) array
        A, b, c of each source; they need not be positive.
    modes : Modes
        What to fit, or the degree lmax.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    array
    """
    sources = _Weighted(field.lon, field.lat, np.asarray(weights, float))
    if len(sources) > design_matrix_up_to(modes):
        return Rings(modes.lmax).matrix(fourier_sums(sources, modes.lmax, threads)[0])

    def block(part):
        basis = harmonics(field.lon[part], field.lat[part], modes)
        a, b, c = sources.weights[:, part]
        turned = np.stack([a * basis[:, 0] + c * basis[:, 1], c * basis[:, 0] + b * basis[:, 1]], axis=1)
        return basis.reshape(len(modes), -1) @ turned.reshape(len(modes), -1).T

    return sum(map_blocks(block, len(sources), max(64, 2**21 // len(modes)), threads))


def leverage(
    field: Field, modes: Modes, inverse: FloatArray, factors: FloatArray | float = 1.0, threads: int | None = None
) -> FloatArray:
    """How much of its own fitted motion each source makes, (n,): between 0 and 1, p/2n on average.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes
        What to fit, or the degree lmax.
    inverse : (p, p) array
        N⁻¹ of the fit.
    factors : (n,) array
        On the weights of the field, as the fit had them.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    array

    Notes
    -----
    Exact for small problems. For large ones p tr W/(2 Σ tr W), which is exact on a uniform sky by the
    addition theorem.
    """
    p = len(modes)
    weights = field.weights * factors
    trace = weights[0] + weights[1]
    if len(field) * p * p > EXACT:
        return np.minimum(p * trace / trace.sum() / 2, 0.9)

    def block(part):
        basis = harmonics(field.lon[part], field.lat[part], modes)
        a, b, c = weights[:, part]
        left = np.tensordot(inverse, basis, 1)
        return (a * np.sum(left[:, 0] * basis[:, 0], 0) + b * np.sum(left[:, 1] * basis[:, 1], 0)
                + 2 * c * np.sum(left[:, 0] * basis[:, 1], 0)) / 2  # fmt: skip

    found = np.concatenate(list(map_blocks(block, len(field), max(64, 2**20 // p), threads)))
    return np.clip(found, 0.0, 0.9)


def outer_products(field: Field, residual: FloatArray, factors: FloatArray) -> FloatArray:
    """factors² C⁻¹ΔΔᵀC⁻¹ of each source as (3, n): what the scores ψ = factors C⁻¹Δ scatter by.

    Parameters
    ----------
    field : Field
        The sources.
    residual : (2, n) array
        Δ. [µas/yr]
    factors : (n,) array
        u, the weight of each source.

    Returns
    -------
    array
    """
    a, b, c = field.weights
    east, north = a * residual[0] + c * residual[1], c * residual[0] + b * residual[1]
    return np.stack([east * east, north * north, east * north]) * factors**2


def sandwich(
    field: Field,
    modes: Modes,
    residual: FloatArray,
    factors: FloatArray,
    slopes: FloatArray,
    *,
    power: float = 0.75,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """H⁻¹ M H⁻¹, (p, p): the covariance of a fit whose scores are Σ Aᵀ u C⁻¹Δ.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes
        What to fit, or the degree lmax.
    residual : (2, n) array
        Δ [µas/yr]
    factors : (n,) array
        u, each source's weight in the fit.
    slopes : (n,) array
        Of u Δ by Δ, in units of C⁻¹: u itself where the weights do not depend on Δ.
    power : float
        Residuals are divided by (1 − leverage) to this power: ½ is HC2, 1 is HC3 of MacKinnon &
        White (1985, J. Econometrics 29, 305). The first is unbiased for the covariance, and so gives pulls
        that are too wide where it is uncertain; halfway they are 1 within 2 % with 400 sources and 96
        coefficients.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    covariance : (p, p) array [(µas/yr)²]
    leverage : (n,) array
    """
    fitted = np.linalg.inv(weighted_matrix(field, field.weights * factors, modes, threads))
    own = leverage(field, modes, fitted, factors, threads)
    slope = np.linalg.inv(weighted_matrix(field, field.weights * slopes, modes, threads))
    scores = outer_products(field, residual, factors / (1 - own) ** power)
    covariance = slope @ weighted_matrix(field, scores, modes, threads) @ slope
    return (covariance + covariance.T) / 2, own
