"""The normal equations by their definition: the design matrix, a block of sources at a time.

Exact to rounding at any degree, and the reference for the faster ways.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.basis import scalar_harmonics, toroidal_harmonics
from vsh.checks.types import FloatArray
from vsh.modes import Modes, ScalarModes
from vsh.system.parallel import map_blocks


def design_matrix_sums(field: Any, modes: Modes, threads: int | None = None) -> tuple[FloatArray, FloatArray, float]:
    """N, b and Σ yᵀ C⁻¹ y of a field: what `fit.normal_equations` adds up."""
    p = len(modes)
    # Enough sources to keep NumPy busy, 64 MiB of whitened basis at most.
    size = max(256, min(2**16, 2**22 // p))
    matrix, rhs, chi2_null = np.zeros((p, p)), np.zeros(p), 0.0
    for n, b, chi2 in map_blocks(
        lambda part: _block(field[part], modes), len(field), size, threads, "normal equations"
    ):
        matrix += n
        rhs += b
        chi2_null += chi2
    return matrix, rhs, chi2_null


def _block(field, modes):
    """N, b and Σ yᵀ C⁻¹ y of a few sources, from the basis in units of each source's error."""
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


def design_matrix_up_to(modes: Modes) -> int:
    """The number of sources up to which the direct sum is the faster one.

    As measured (docs/performance.md): below it the fixed cost of the rings tells, above it
    the design matrix.
    """
    return max(1000, 2**18 // max(modes.lmax, 1) ** 2)
