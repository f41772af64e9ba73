"""The normal equations of degree 1, as fast as NumPy makes them.

Degree 1 is ω × r + g − (g·r) r, six fields that need no recurrence. The sums stay in one
thread: a block takes some microseconds a step, and threads lose more at handing the
interpreter round than they gain (docs/performance.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.checks.types import FloatArray
from vsh.coefficients import FIRST_DEGREE

#: Sources in a block: all of its scratch, 1 MiB a dozen rows, stays in the cache.
BLOCK = 2**14


def dipole_sums(field: Any) -> tuple[FloatArray, FloatArray, float]:
    """N, b and Σ yᵀ C⁻¹ y of degree 1: what `fit.normal_equations` adds up."""
    size = min(BLOCK, len(field))
    scratch, rows = np.empty((20, size)), np.empty((7, 2, size))
    gram = np.zeros((7, 7))
    for start in range(0, len(field), size):
        part = field[start : start + size]
        if len(part) < size:
            scratch, rows = np.empty((20, len(part))), np.empty((7, 2, len(part)))
        _fill(part, scratch, rows)
        flat = rows.reshape(7, -1)
        for i in range(7):  # a matrix times a vector: three times as fast as the small product A Aᵀ
            gram[i, : i + 1] += flat[: i + 1] @ flat[i]
    gram = gram + np.tril(gram, -1).T
    # From the rows' order and signs to (ω_x, ω_y, ω_z, g_x, g_y, g_z), and from vectors to coefficients.
    take = np.zeros((7, 7))
    take[range(7), [3, 2, 4, 0, 1, 5, 6]] = [-1, -1, 1, -1, 1, 1, 1]
    take[:6] = np.kron(np.eye(2), np.linalg.inv(FIRST_DEGREE).T) @ take[:6]
    gram = take @ gram @ take.T
    return gram[:6, :6], gram[:6, 6], float(gram[6, 6])


def _fill(field, scratch, rows):
    """The seven rows (six fields and the motions), each decorrelated and of unit weight.

    With s = sin and c = cos of α and δ, the fields and their signs are

        −g_x: (sα, sδ cα)   g_y: (cα, −sδ sα)   −ω_y: (sδ sα, cα)   −ω_x: (sδ cα, −sα)
        ω_z: (cδ, 0)        g_z: (0, cδ)
    """
    half, square, sin, cos = scratch[:8].reshape(4, 2, -1)
    p, mixed, root, inverse = scratch[8:12], scratch[12:16], scratch[16], scratch[17:20]
    # Sine and cosine by the tangent of half the angle, as in vsh.sphere.sin_cos, without new memory.
    np.multiply(field.lon, 0.5, out=half[0])
    np.multiply(field.lat, 0.5, out=half[1])
    np.tan(half, out=half)
    np.multiply(half, half, out=square)
    np.add(square, 1, out=sin)
    np.divide(1, sin, out=sin)
    np.subtract(1, square, out=cos)
    cos *= sin
    sin *= half
    sin += sin
    p[0], p[1] = sin[0], cos[0]
    np.multiply(p[:2], sin[1], out=p[2:])

    # L⁻¹ with L Lᵀ = C: 1/σ_1, 1/(σ_2 √(1 − ρ²)) and ρ/(σ_1 √(1 − ρ²)).
    np.multiply(field.rho, field.rho, out=root)
    np.subtract(1, root, out=root)
    np.sqrt(root, out=root)
    inverse[0] = field.sigma[0]
    np.multiply(field.sigma[1], root, out=inverse[1])
    np.divide(1, inverse[:2], out=inverse[:2])
    np.multiply(field.rho, inverse[0], out=inverse[2])
    inverse[2] /= root

    east, north = rows[:, 0], rows[:, 1]
    np.multiply(p, inverse[0], out=east[:4])
    np.multiply(cos[1], inverse[0], out=east[4])
    east[5] = 0
    np.multiply(p[::-1], inverse[1], out=north[:4])
    np.negative(north[1:4:2], out=north[1:4:2])
    np.multiply(p, inverse[2], out=mixed)
    north[:4] -= mixed
    np.multiply(cos[1], inverse[2], out=north[4])
    np.negative(north[4], out=north[4])
    np.multiply(cos[1], inverse[1], out=north[5])
    np.multiply(field.motion[0], inverse[0], out=east[6])
    np.multiply(field.motion[1], inverse[1], out=north[6])
    np.multiply(field.motion[0], inverse[2], out=mixed[0])
    north[6] -= mixed[0]
