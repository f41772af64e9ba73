"""Oracles of the response of an attitude: the joint solution itself, and the closed form for stars held fixed."""

import numpy as np
from scipy.special import gammaln, lpmv

from sim.agis._system import Iteration, System
from sim.agis.passes._scans import evaluate_splines
from vsh.basis import harmonics
from vsh.sky.sphere import triad
from vsh.tools.errors import ConvergenceError, FrameError

#: Templates that go through the sources and the attitude together.
_TOGETHER = 8


def power_after_attitude_solution(l: int, kind: str, basic_angle: float = np.radians(106.5)) -> float:
    """The share of the power along scan of an isotropic field that two fields of view leave, stars held fixed.

    Harmonic m along the scan circle keeps sin²(mΓ/2) of its power; T moves along it as dP_lm/dθ at the equator, S as m
    P_lm. A rotation that changes with time (T of degree 1) is attitude, and nothing of it is left.
    """
    m = np.arange(l + 1)
    norm = np.exp((gammaln(l - m + 1) - gammaln(l + m + 1)) / 2)
    if kind == "S":
        amplitude = norm * m * lpmv(m, l, 0.0)
    else:
        amplitude = norm * np.where(m < l, (l + m) * lpmv(m, l - 1, 0.0), 0.0)
    power = amplitude**2 * np.where(m > 0, 2, 1)
    return float(np.sum(power * np.sin(m * basic_angle / 2) ** 2) / power.sum())


class ExactResponse:
    """Response of the attitude to templates by the joint solution: for small problems, and to try `Response` on.

    Each template costs a joint solution, and there are 2 × 70 for a wave at degree 5: 65 CPU seconds in all with 1500
    sources and knots of 3000 s. Times are counted from the middle of the mission.
    """

    def __init__(self, system: System, *, tolerance: float = 1e-8, iterations: int = 300) -> None:
        self.system = system
        if system.scans.frame != "icrs":
            raise FrameError(f"observations stand in ICRS, the sources of this solution in {system.scans.frame} axes")
        self.tolerance, self.iterations = tolerance, iterations
        self._taken = {}

    def left(self, lon, lat, scan, time, modes, functions, *, view=None):  # one attitude is for both fields of view
        """Compute what the attitude leaves along scan of functions times modes, (k, F p), as does `Response.left`."""
        attitude = self.taken(modes, functions)
        p, q, _ = triad(lon, lat)
        basis = harmonics(lon, lat, modes)
        along = basis[:, 0] * scan[0] + basis[:, 1] * scan[1]
        remainder = np.einsum("fk,pk->kfp", functions(time), along).reshape(len(time), -1)
        normal = q * scan[0] - p * scan[1]
        scans = self.system.scans
        knot_time = (time + scans.middle) / scans.spacing
        knot = np.clip(knot_time.astype(int), 0, scans.intervals - 1)
        for i, weight in enumerate(evaluate_splines(knot_time - knot)):
            remainder += weight[:, None] * np.einsum("ik,kif->kf", normal, attitude[knot + i])
        return remainder

    def taken(self, modes, functions):
        """Compute the coefficients (c, 3, F p) that the attitude takes of functions times modes, kept for the next time."""
        scans, passes = self.system.scans, self.system.passes
        key = modes, functions(scans.time() - scans.middle).tobytes()
        if key in self._taken:
            return self._taken[key]
        basis = harmonics(scans.lon, scans.lat, modes)
        sin, cos = np.asarray(scans.sin, float), np.asarray(scans.cos, float)
        at = functions(scans.time() - scans.middle)
        coefficients = np.empty((self.system.coefficients, 3, len(at) * len(modes)))
        for start in range(0, coefficients.shape[-1], _TOGETHER):
            numbers = range(start, min(start + _TOGETHER, coefficients.shape[-1]))
            of_sources, of_attitude, size = [], [], []
            for number in numbers:
                f, mode = divmod(number, len(modes))
                east, north = (at[f] * component[scans.source] for component in basis[mode])
                pair = passes.adjoint(east * sin + north * cos, north * sin - east * cos)
                size.append(np.sum(scans.weights[0, scans.source] * (east**2 + north**2)))
                of_sources.append(self.system.reduce(*pair))
                of_attitude.append(pair[1])
            right = np.stack(of_sources, axis=-1)
            right[~self.system.solved] = 0
            work = Iteration(self.system, right)
            # Beside the whole template: of a rotation in time nothing is left for the sources but rounding.
            residual = np.inf
            for _ in range(self.iterations):
                work.step()
                residual = float(np.sqrt(np.max(np.abs(work.rz) / size)))
                if residual < self.tolerance:
                    break
            else:
                raise ConvergenceError(f"templates are known to {residual:.1g} after {self.iterations} iterations")
            attitude_rhs = np.stack(of_attitude, axis=-1) - passes.to_attitude(work.x)
            coefficients[..., start : start + len(numbers)] = self.system.attitude_of(attitude_rhs)
        self._taken = {key: coefficients}
        return coefficients
