"""What a solved attitude takes of motions that change with time, by the joint solution itself.

The way that `Response` approximates from the scanning law alone: every template is put into sky and attitude, solved
together, and what the attitude took of it is taken from the template. For a source with observations y = w − A ε̂ and
five parameters taken out this is generalised least squares of the joint problem, exactly.
"""

from typing import Any

import numpy as np

from sim.agis._response import Functions, template_key
from sim.agis._solve import Iteration
from sim.agis._system import System
from sim.agis.passes import spline_at
from vsh.basis import harmonics
from vsh.modes import Modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import ConvergenceError, FrameError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray, IntArray

#: Templates that go through the sources and the attitude together.
_TOGETHER = 8


class ExactResponse(InNotebook):
    """What the attitude took of any template, solved for: for small problems, and to try `Response` on.

    Parameters
    ----------
    system : System
        The sources from which the attitude was solved, those whose epochs are looked at among them or not, in ICRS.
    tolerance : float
        Tolerance of the conjugate gradients: the largest preconditioned residual, of the template itself.
    iterations : int
        The largest number of them.

    Raises
    ------
    FrameError
        If the sources are not in ICRS.

    Notes
    -----
    Each template costs a joint solution, and there are 2 × 70 for a wave at degree 5: 65 CPU seconds in all with 1500
    sources and knots of 3000 s (`benchmarks/time_axis.py exact`). Times are counted from the middle of the mission.
    """

    def __init__(self, system: System, *, tolerance: float = 1e-8, iterations: int = 300) -> None:
        self.system = arguments.a(System)("system", system)
        if system.scans.frame != "icrs":
            raise FrameError(f"observations stand in ICRS, the sources of this solution in {system.scans.frame} axes")
        self.tolerance = arguments.positive("tolerance", tolerance)
        self.iterations = arguments.whole("iterations", iterations)
        self._taken: dict[Any, FloatArray] = {}

    def __repr__(self) -> str:
        scans = self.system.scans
        return f"<ExactResponse: {scans.n_sources} sources, {scans.intervals} intervals in {scans.years:g} years>"

    def left(
        self,
        lon: FloatArray,
        lat: FloatArray,
        scan: FloatArray,
        time: FloatArray,
        modes: Modes,
        functions: Functions,
        *,
        view: IntArray | None = None,  # as of Response; an attitude serves both fields of view
    ) -> FloatArray:
        """What is left along the scan of every function of time × mode, (k, F p); arguments as of `Response.left`.

        Parameters
        ----------
        lon, lat : (k,) arrays
            Where the source of each observation is. [rad, ICRS]
        scan : (2, k) array
            Direction of each scan, east and north.
        time : (k,) array
            Since the middle of the mission. [yr]
        modes : Modes
            What is seen of the sky.
        functions : function
            From times to the functions at them, (F, k).
        view : (k,) array, optional
            Not used.
        """
        attitude = self.taken(modes, functions)
        p, q, _ = triad(lon, lat)
        basis = harmonics(lon, lat, modes)
        along = basis[:, 0] * scan[0] + basis[:, 1] * scan[1]
        left = np.einsum("fk,pk->kfp", functions(time), along).reshape(len(time), -1)
        normal = q * scan[0] - p * scan[1]
        scans = self.system.scans
        for coefficient, weight in spline_at(scans, time + scans.middle):
            left += weight[:, None] * np.einsum("ik,kif->kf", normal, attitude[coefficient])
        return left

    def taken(self, modes: Modes, functions: Functions) -> FloatArray:
        """What the attitude takes of each of the `functions` times each of the `modes`, kept for the next time.

        Parameters
        ----------
        modes : Modes
            Modes of the templates.
        functions : function
            From times to the functions at them, (F, k).

        Returns
        -------
        (coefficients, 3, F p) array
            Coefficients of the attitude's spline.

        Raises
        ------
        ConvergenceError
            If the iterations do not do.
        """
        scans, passes = self.system.scans, self.system.passes
        key = template_key(modes, functions)
        if key in self._taken:
            return self._taken[key]
        basis = harmonics(scans.lon, scans.lat, modes)
        sin, cos = np.asarray(scans.sin, float), np.asarray(scans.cos, float)
        at = functions(scans.time() - scans.middle)
        out = np.empty((self.system.coefficients, 3, len(at) * len(modes)))
        for start in range(0, out.shape[-1], _TOGETHER):
            some = range(start, min(start + _TOGETHER, out.shape[-1]))
            of_sources, of_attitude, size = [], [], []
            for number in some:
                f, mode = divmod(number, len(modes))
                east, north = (at[f] * each[scans.source] for each in basis[mode])
                pair = passes.adjoint(east * sin + north * cos, north * sin - east * cos)
                size.append(np.sum(scans.weights[0, scans.source] * (east**2 + north**2)))
                of_sources.append(self.system.reduce(*pair))
                of_attitude.append(pair[1])
            right = np.stack(of_sources, axis=-1)
            right[~self.system.solved] = 0
            work = Iteration(self.system, right)
            # Beside the whole template: of a rotation in time nothing is left for the sources but rounding.
            left = np.inf
            for _ in range(self.iterations):
                work.step()
                left = float(np.sqrt(np.max(np.abs(work.rz) / size)))
                if left < self.tolerance:
                    break
            else:
                raise ConvergenceError(
                    f"what the attitude takes of templates is known to {left:.1g} after {self.iterations} "
                    f"iterations, not to {self.tolerance:g}: allow more iterations, or a larger tolerance"
                )
            known = np.stack(of_attitude, axis=-1) - passes.to_attitude(work.x)
            out[..., start : start + len(some)] = self.system.attitude_of(known)
        self._taken = {key: out}
        return out
