"""Conjugate gradients for the sources' equations, and simple iteration (Bombrun et al. 2012, A&A 538, A77)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.checks.types import FloatArray


class Iteration:
    """(S − C A⁻¹ Cᵀ) x = r step by step, for several right-hand sides at once.

    Sources and attitude solved in turn are a simple iteration with the preconditioner S⁻¹; with conjugate directions they are
    conjugate gradients with Gauss–Seidel's. The part of x along the null space stays what it was.

    Parameters
    ----------
    equations : Equations
        With `apply` and `precondition`.
    r : (n, 5, K) array
        The right-hand sides.
    conjugate : bool
        Or simple.
    """

    def __init__(self, equations: Any, r: FloatArray, conjugate: bool = True) -> None:
        self.equations, self.conjugate = equations, conjugate
        self.x, self.r = np.zeros_like(r), r.copy()
        self.z = equations.precondition(self.r)
        self.p = self.z.copy()
        self.rz = _dot(self.r, self.z)
        self.first = self.rz.copy()
        #: What the last step added to rᵀ N⁺ r, whose sum is a lower bound of it that only grows.
        self.gain = np.zeros_like(self.rz)

    @property
    def residual(self) -> float:
        """The largest preconditioned residual left of all right-hand sides, of the first."""
        start = np.where(self.first > 0, self.first, 1.0)
        return float(np.sqrt(np.max(np.abs(self.rz) / start)))

    def step(self) -> None:
        """One pass through sources and attitude."""
        moving = self.rz > 0
        if self.conjugate:
            q = self.equations.apply(self.p)
            curvature = _dot(self.p, q)
            # A right-hand side that is solved to the last bit has no direction left.
            moving &= curvature > 0
            step = np.where(moving, self.rz / np.where(moving, curvature, 1.0), 0.0)
            self.x += step * self.p
            self.r -= step * q
            self.gain = step * self.rz
        else:
            self.x += self.z
            self.r -= self.equations.apply(self.z)
        self.z = self.equations.precondition(self.r)
        new = _dot(self.r, self.z)
        turn = np.where(moving, new / np.where(moving, self.rz, 1.0), 0.0)
        self.p = self.z + turn * self.p if self.conjugate else self.z
        self.rz = np.where(moving, new, 0.0)

    def state(self) -> dict[str, FloatArray]:
        """All that the next steps depend on."""
        return {name: getattr(self, name) for name in ("x", "r", "z", "p", "rz", "first", "gain")}

    def restore(self, state: dict[str, FloatArray]) -> None:
        """Go on from a state."""
        for name in self.state():
            setattr(self, name, np.array(state[name]))


def _dot(a, b):
    """Σ over sources and parameters, (K,); not by BLAS, whose threads would change the last bits."""
    return (a * b).reshape(-1, a.shape[-1]).sum(axis=0)
