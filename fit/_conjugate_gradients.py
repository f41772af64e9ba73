"""Conjugate gradients with a preconditioner, and the condition number they see on the way."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from vsh.checks.types import FloatArray
from vsh.errors import ConvergenceError
from vsh.system.progress import progress_bar


def conjugate_gradients(
    system: Any, rhs: FloatArray, tolerance: float, max_iterations: int, words: str | None
) -> tuple[FloatArray, int, float, float]:
    """Solve system c = rhs."""
    x, r = np.zeros_like(rhs), rhs.copy()
    z = system.precondition(r)
    p, rz = z.copy(), r @ z
    start, alphas, betas = rz, [], []
    bar = progress_bar(None, max_iterations, words, bool(words), " steps")
    with bar:
        for iteration in range(1, max_iterations + 1):
            if rz <= tolerance**2 * start:
                return x, iteration - 1, float(np.sqrt(rz / start)) if start else 0.0, _condition(alphas, betas)
            q = system.apply(p)
            alpha = rz / (p @ q)
            x += alpha * p
            r -= alpha * q
            z = system.precondition(r)
            rz, old = r @ z, rz
            alphas.append(alpha)
            betas.append(rz / old)
            p = z + betas[-1] * p
            bar.update()
            bar.set_postfix_str(f"residual {np.sqrt(rz / start):.1e} → {tolerance:.0e}", refresh=False)
    moving = np.bincount(system.modes.degrees, weights=p**2 * system.diagonal)
    worst = ", ".join(str(l) for l in sorted(np.argsort(-moving)[:5]))
    raise ConvergenceError(
        f"no convergence to {tolerance:.0e} in {max_iterations} iterations (residual {np.sqrt(rz / start):.1e}, condition "
        f"at least {_condition(alphas, betas):.1e}). Not determined: combinations of degrees {worst}, among others; "
        f"{100 * system.empty_sky():.0f} % of the sky is empty at this resolution. Give a prior_power, lower lmax "
        f"from {system.modes.lmax}, or allow more iterations"
    )


def _condition(alphas, betas):
    """From the coefficients of the iteration, by the Lanczos matrix they make up."""
    if not alphas:
        return 1.0
    alphas, betas = np.array(alphas), np.array(betas)
    diagonal = 1 / alphas
    diagonal[1:] += betas[:-1] / alphas[:-1]
    values = eigvalsh_tridiagonal(diagonal, np.sqrt(betas[:-1]) / alphas[:-1])
    return float(values[-1] / max(values[0], 1e-300))
