"""Degrees beyond those in which something shared is looked for: what they leak into these is allowed for.

A class that does not see the whole sky takes systematics of higher degrees for its own lower ones: on two caps beyond
latitude 40° degrees 6 to 16 put 170 times the power of degree 1 into it. Where the normal equations hold higher
degrees, h, these have a prior of the power P that the class has by a first estimate, and are marginalised:

    N' = N − N_lh (N_hh + P⁻¹)⁻¹ N_hl,   b' = b − N_lh (N_hh + P⁻¹)⁻¹ b_h,   χ²' = χ² − b_hᵀ (N_hh + P⁻¹)⁻¹ b_h,

with (N + P⁻¹)⁻¹ = √P (1 + √P N √P)⁻¹ √P, which bears P = 0. Each class has its own h: what classes that see the same
part share of these would cancel in their differences, whose errors are then larger than need be.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fit.background._blocks import condition_of, parities
from fit.background._draws import Lot
from fit.normal import NormalEquations
from vsh.modes import Modes
from vsh.tools.errors import DegeneracyError
from vsh.tools.types import FloatArray

#: Beyond this condition of its normal matrix a class takes higher degrees for lower ones: the sky outside the Galactic
#: plane has 14 at degree 5, two caps beyond latitude 40° have 1300.
PART = 100.0
#: Equations of so many degrees more allow for that.
BEYOND = 3


def widened(
    normals: Sequence[NormalEquations], make: Callable[[Any, int], NormalEquations], classes: Iterable[Any]
) -> list[NormalEquations]:
    """Equations of classes, or what `make` makes of all to three degrees more where one sees a part of the sky."""
    lmax = normals[0].modes.lmax
    if not any(sees_part(each, lmax) for each in normals):
        return list(normals)
    return [make(each, lmax + BEYOND) for each in classes]


def sees_part(normal: NormalEquations, lmax: int) -> bool:
    """Whether sources are so few, or see so small a part of the sky, that higher degrees leak into those to `lmax`."""
    at = np.flatnonzero(normal.modes.degrees <= lmax)
    try:
        return condition_of(normal.matrix[np.ix_(at, at)]) > PART
    except DegeneracyError:  # an empty class: that is said elsewhere
        return False


def powers_beyond(lots: Sequence[Lot], modes: Modes) -> FloatArray:
    """Variances of the coefficients of each class, (K, p), the mean over draws and shapes."""
    total: FloatArray = np.zeros(())
    for lot in lots:
        shares = [lot.blocks.shares(x)[:2].diagonal(axis1=1, axis2=2) for x in lot.x]  # (2, K)
        own = np.tensordot(lot.weight, shares, 1)
        total = total + lot.probability * own[parities(modes)].T * lot.scale * lot.spectrum.variances(modes)
    return total


def marginalised(normal: NormalEquations, modes: Modes, variances: FloatArray, noise_scale: float) -> NormalEquations:
    """The equations of `modes`, all higher degrees marginalised with a prior of so much power, (p,)."""
    low, high = (np.flatnonzero(at) for at in (normal.modes.degrees <= modes.lmax, normal.modes.degrees > modes.lmax))
    root = np.sqrt(variances[high]) / noise_scale
    inner = np.eye(len(high)) + root[:, None] * normal.matrix[np.ix_(high, high)] * root
    across = normal.matrix[np.ix_(high, low)]
    sides = root[:, None] * np.column_stack([across, normal.rhs[high]])
    solved = root[:, None] * cho_solve(cho_factor(inner), sides)
    matrix = normal.matrix[np.ix_(low, low)] - across.T @ solved[:, :-1]
    return replace(
        normal,
        modes=modes,
        matrix=(matrix + matrix.T) / 2,
        rhs=normal.rhs[low] - across.T @ solved[:, -1],
        chi2_null=float(normal.chi2_null - normal.rhs[high] @ solved[:, -1]),
        templates=tuple(_cut(each, low, modes) for each in normal.templates),
    )


def _cut(template, low, modes):
    """A template of these modes alone, of 1 µas/yr rms over the sky."""
    values = template.values[low]
    return template._replace(values=values / np.sqrt(values**2 @ modes.norm2 / (4 * np.pi)))
