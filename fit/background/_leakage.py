"""Degrees beyond those in which something shared is looked for: what they leak into these is allowed for.

A class that does not see the whole sky takes systematics of higher degrees for its own lower ones: on two caps beyond
latitude 40° degrees 6 to 16 put 170 times the power of degree 1 into it. Where the normal equations hold higher
degrees, h, these have a prior of the power P that the class has by a first estimate, and are marginalised:

    N' = N − N_lh (N_hh + P⁻¹)⁻¹ N_hl,   b' = b − N_lh (N_hh + P⁻¹)⁻¹ b_h,   χ²' = χ² − b_hᵀ (N_hh + P⁻¹)⁻¹ b_h.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fit.background._blocks import parities
from fit.background._draws import Lot
from fit.normal import NormalEquations
from vsh.models.covariance import Spectrum
from vsh.modes import Modes
from vsh.tools.types import FloatArray

#: Beyond this condition of its normal matrix a class takes higher degrees for lower ones; so many more allow for that.
PART, BEYOND = 100.0, 3


def sees_part(normal: NormalEquations, lmax: int) -> bool:
    """Whether sources cover a part of the sky alone, so that degrees higher than `lmax` leak into those."""
    at = np.flatnonzero(normal.modes.degrees <= lmax)
    size = np.sqrt(np.diag(normal.matrix)[at])
    if not (size > 0).all():
        return False  # an empty class: that is said elsewhere
    return bool(np.linalg.cond(normal.matrix[np.ix_(at, at)] / np.outer(size, size)) > PART)


def powers_beyond(
    lots: Sequence[Lot], probability: FloatArray, spectra: Sequence[tuple[str, Spectrum]], modes: Modes
) -> FloatArray:
    """Variances of the coefficients of each class, (K, p), the mean over draws and shapes."""
    total: FloatArray = np.zeros(())
    for lot, p, (_, spectrum) in zip(lots, probability, spectra, strict=True):
        shares = [lot.blocks.shares(x)[:2].diagonal(axis1=1, axis2=2) for x in lot.x]  # (2, K)
        own = np.tensordot(lot.weight, shares, 1)
        total = total + p * own[parities(modes)].T * lot.scale * spectrum.variances(modes)
    return total


def marginalised(normal: NormalEquations, modes: Modes, variances: FloatArray, noise_scale: float) -> NormalEquations:
    """The equations of `modes`, all higher degrees marginalised with a prior of so much power, (p,)."""
    low, high = (np.flatnonzero(at) for at in (normal.modes.degrees <= modes.lmax, normal.modes.degrees > modes.lmax))
    inner = normal.matrix[np.ix_(high, high)] + np.diag(noise_scale**2 / variances[high])
    across = normal.matrix[np.ix_(high, low)]
    solved = cho_solve(cho_factor(inner), np.column_stack([across, normal.rhs[high]]))
    matrix = normal.matrix[np.ix_(low, low)] - across.T @ solved[:, :-1]
    return replace(
        normal,
        modes=modes,
        matrix=(matrix + matrix.T) / 2,
        rhs=normal.rhs[low] - across.T @ solved[:, -1],
        chi2_null=float(normal.chi2_null - normal.rhs[high] @ solved[:, -1]),
        templates=tuple(each._replace(values=each.values[low]) for each in normal.templates),
    )
