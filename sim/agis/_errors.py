"""Exact errors of what is made of a joint solution, without drawing any noise."""

from __future__ import annotations

import numpy as np

from sim.agis._equations import Equations
from sim.agis._iteration import Iteration
from sim.agis._motion_fit import MotionFit, sources_at
from sim.variability import Variability, chain_products
from vsh.checks import arrays
from vsh.checks.types import ArrayLike, FloatArray
from vsh.errors import ConvergenceError, ParameterError
from vsh.modes import Modes, as_modes
from vsh.system.parallel import blas_for
from vsh.system.progress import progress_bar

#: Functionals solved for together.
TOGETHER = 3
#: Iterations over which the sum of the variances must have come to rest.
_REST = 10


class ExactErrors(Equations):
    """Equations that tell the errors of what is made of their solution."""

    def formal_covariance(
        self, modes: Modes | int, lon: ArrayLike | None = None, lat: ArrayLike | None = None
    ) -> FloatArray:
        """Covariance of a fit of harmonics to the motions as it would be quoted: sources for themselves, the attitude known."""
        return MotionFit(self, as_modes(modes), sources_at(self.scans, lon, lat)).formal

    def true_covariance(
        self,
        modes: Modes | int,
        lon: ArrayLike | None = None,
        lat: ArrayLike | None = None,
        *,
        variability: Variability | None = None,
        variable: ArrayLike | None = None,
        tolerance: float = 1e-3,
        iterations: int = 2000,
        progress: bool = False,
    ) -> FloatArray:
        """Covariance that the same fit really has, with all that sources share through the attitude; exact, without noise drawn.

        A solve by conjugate gradients for each mode: their running sum is a lower bound of the variance that only grows.
        """
        fit = MotionFit(self, as_modes(modes), sources_at(self.scans, lon, lat))
        g = fit.functionals(np.arange(len(fit.modes)))
        return self._covariance(g, tolerance, iterations, progress, variability, variable)

    def covariance_of(
        self, functionals: ArrayLike, *, variability: Variability | None = None, variable: ArrayLike | None = None,
        tolerance: float = 1e-3, iterations: int = 2000, progress: bool = False,
    ) -> FloatArray:  # fmt: skip
        """Covariance of any linear functionals Σ g x of the sources' parameters."""
        g = arrays.float_array("functionals", functionals)
        if g.ndim != 3 or g.shape[:2] != (self.scans.n_sources, 5):
            raise ParameterError(f"functionals have the shape ({self.scans.n_sources}, 5, K), not {g.shape}")
        return self._covariance(g, tolerance, iterations, progress, variability, variable)

    def global_covariances(
        self, *, tolerance: float = 1e-3, iterations: int = 2000, progress: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Covariances of the global parameters: as sources that know the attitude would give them, and as they are."""
        if self.motion is None:
            raise ParameterError("there are no global parameters: give System a motion")
        g = np.stack([self.motion.functional(k) for k in range(len(self.motion.names))], axis=-1)
        true = self._covariance(g, tolerance, iterations, progress)
        # What the sources' own motions leave of y: the mean of Gy + own is no y.
        return np.linalg.inv(self._low_rank), true + np.linalg.inv(self.motion.normal)

    def _covariance(self, functionals, tolerance, iterations, progress, variability=None, variable=None):
        """gᵀ N⁺ g of each pair of functionals (n, 5, K), what the null space does to them left out."""
        right = self._seen(functionals)
        solved = np.empty_like(right)
        bar = progress_bar(words="exact errors", shown=progress, unit=" iterations")
        with bar, blas_for(0):
            for start in range(0, right.shape[-1], TOGETHER):
                here = slice(start, start + TOGETHER)
                solved[..., here] = _solved(self, np.ascontiguousarray(right[..., here]), tolerance, iterations, bar)
        k = right.shape[-1]
        out = right.reshape(-1, k).T @ solved.reshape(-1, k)
        if variability is not None and variability.sigma > 0:
            out += self._varying(solved, variability, variable)
        return (out + out.T) / 2

    def _seen(self, functionals):
        """Functionals of parameters from which the null space is taken out, by the blocks as weights."""
        right = functionals.copy()
        right[~self.solved] = 0
        if self.defect:
            basis, weighted, normal = self.rotations()
            share = np.linalg.solve(normal, np.einsum("kni,nir->kr", basis, right))
            right -= np.einsum("kr,kni->nir", share, weighted)
        return right

    def _varying(self, solved, variability, variable):
        """What photocentres that vary add: Σ over sources of aᵀ C a, a how much each observation counts in a functional."""
        scans = self.scans
        order = np.argsort(scans.source, kind="stable")  # of a source, in the order of time
        if variable is not None:
            order = order[np.asarray(variable, bool)[scans.source[order]]]
        owner, time = scans.source[order], scans.time()[order]
        weights = scans.weights[:, owner] * self.solved[owner]
        sin, cos = (column[order].astype(float) for column in (scans.sin, scans.cos))
        shares = []
        for x in np.moveaxis(solved, -1, 0):
            attitude = self.attitude_of(-self.passes.to_attitude(np.ascontiguousarray(x)[..., None])[..., 0])
            along, across = (w * seen[order] for w, seen in zip(weights, self.passes.predict(x, attitude), strict=True))
            shares += [np.stack([along * sin - across * cos, along * cos + across * sin])]
        found = chain_products(np.array(shares), owner, time, variability.tau)
        return variability.sigma**2 * found


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
