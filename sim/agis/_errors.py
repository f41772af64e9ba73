"""Exact errors of what is made of a joint solution, without drawing any noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.agis._iteration import Iteration
from vsh.errors import ConvergenceError
from vsh.system.parallel import blas_for
from vsh.system.progress import progress_bar
from vsh.types import FloatArray

#: Functionals solved for together.
TOGETHER = 3
#: Iterations over which the sum of the variances must have come to rest.
_REST = 10


def covariance_of(
    equations: Any, functionals: FloatArray, *, tolerance: float = 1e-3, iterations: int = 2000, progress: bool = False
) -> FloatArray:
    """Covariance of linear functionals of the sources: gᵀ N⁺ g of each pair.

    Parameters
    ----------
    equations : Equations
        The normal equations.
    functionals : (n, 5, K) array
        Σ g x is what is asked for. What the null space does to it is left out: the frame is taken for known.
    tolerance : float
        Relative growth of a variance in ten iterations at which it is taken for the whole.
    iterations : int
        At most.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    (K, K) array

    Raises
    ------
    ConvergenceError
        If the variances still grow; the message says how much they are at least.
    """
    right = functionals.copy()
    right[~equations.solved] = 0
    if equations.defect:
        # g of x without its rotation: the transpose of what takes the rotation out.
        basis = equations.null_space()[: equations.defect]
        basis[:, ~equations.solved] = 0
        weighted = np.einsum("nij,knj->kni", equations.blocks, basis)
        share = np.linalg.solve(np.einsum("kni,lni->kl", weighted, basis), np.einsum("kni,nir->kr", basis, right))
        right -= np.einsum("kr,kni->nir", share, weighted)
    solved = np.empty_like(right)
    bar = progress_bar(words="exact errors", shown=progress, unit=" iterations")
    with bar, blas_for(0):
        for start in range(0, right.shape[-1], TOGETHER):
            here = slice(start, start + TOGETHER)
            solved[..., here] = _solved(equations, np.ascontiguousarray(right[..., here]), tolerance, iterations, bar)
    # As matrices of BLAS: the functionals are few.
    k = right.shape[-1]
    out = right.reshape(-1, k).T @ solved.reshape(-1, k)
    return (out + out.T) / 2


def _solved(equations, right, tolerance, iterations, bar):
    work = Iteration(equations, right)
    total, gains = np.zeros(right.shape[-1]), []
    for _ in range(iterations):
        work.step()
        gains.append(work.gain)
        total += work.gain
        bar.update()
        bar.set_postfix_str(f"σ at least {', '.join(f'{x:.3g}' for x in np.sqrt(total))}", refresh=False)
        grown = np.sum(gains[-_REST:], axis=0) / np.where(total > 0, total, 1.0)
        if (len(gains) >= _REST and grown.max() < tolerance) or work.residual < 1e-12:
            return work.x
    raise ConvergenceError(
        f"variances still grew by {100 * grown.max():.2g} % in the last {_REST} of {iterations} iterations; standard errors are at "
        f"least {', '.join(f'{x:.4g}' for x in np.sqrt(total))}. Allow more iterations, or a larger tolerance"
    )
