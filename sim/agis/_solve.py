"""From observations to sources and attitude: the start, the iterations, when to stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from sim.agis._checkpoint import key_of, load, save
from sim.agis._iteration import Iteration
from sim.agis._motion_fit import MotionFit
from sim.agis.results import AgisSolution
from vsh.checks.types import FloatArray, PathName
from vsh.system.parallel import blas_for
from vsh.system.progress import progress_bar

#: Iterations within which the low degrees must have come to rest.
REST = 10
#: Iterations between two checkpoints.
_EVERY = 5
#: Residual below which nothing is left to do in double precision.
_SOLVED = 1e-13


def solve_observations(
    equations: Any,
    along: FloatArray,
    across: FloatArray,
    *,
    start: FloatArray,
    attitude: FloatArray,
    known: FloatArray | None,
    first: Literal["sources", "attitude"],
    conjugate: bool,
    iterations: int,
    stop: float | None,
    fit: MotionFit,
    watch: Callable[[int, FloatArray], None] | None,
    checkpoint: PathName | None,
    progress: bool,
) -> AgisSolution:
    """Solve; arguments as of `System.solve`, checked there."""
    passes = equations.passes
    x = start
    if first == "sources":
        of_sources, _ = passes.adjoint(*_left(passes, along, across, x, attitude))
        x = x + equations.precondition((of_sources - _held(equations, x))[..., None])[..., 0]
    of_sources, of_attitude = passes.adjoint(*_left(passes, along, across, x, np.zeros_like(attitude)))
    if known is not None:
        of_attitude += known / equations.prior**2
    right = equations.reduce(of_sources, of_attitude) - _held(equations, x)
    right[~equations.solved] = 0
    work = Iteration(equations, right[..., None], conjugate)

    sigma = np.sqrt(np.diag(fit.formal))
    history, updates = [fit.of(x[..., None])[:, 0]], []
    key = None
    if checkpoint is not None:
        key = key_of(
            (right, of_attitude, x, equations.prior, equations.smoothing, conjugate, fit.sources, len(fit.modes))
        )
        state = load(checkpoint, key)
        if state is not None:
            history, updates = list(state.pop("history")), list(state.pop("updates"))
            work.restore(state)

    def keep():
        if checkpoint is not None and key is not None:
            save(checkpoint, key, work.state() | {"history": np.array(history), "updates": np.array(updates)})

    bar = progress_bar(
        total=iterations, words="joint solution", shown=progress, unit=" iterations", initial=len(history)
    )
    with bar, blas_for(0):  # its threads would wait for each other longer than they work
        while True:
            if watch is not None:
                watch(len(history), x + work.x[..., 0])
            rested = stop is not None and len(history) > REST and _moved(history, sigma) < stop
            if rested or len(history) >= iterations or work.residual < _SOLVED:
                break
            work.step()
            history.append(fit.of(x[..., None] + work.x)[:, 0])
            updates.append(float(np.sqrt(np.mean(work.z[equations.solved, 2] ** 2))))
            bar.update()
            bar.set_postfix_str(
                f"low degrees moved by {_moved(history, sigma):.2g} σ in {min(REST, len(history) - 1)}", refresh=False
            )
            if len(history) % _EVERY == 0:
                keep()
    keep()
    solved = work.x[..., 0]
    h = equations.attitude_of(of_attitude - passes.to_attitude(work.x)[..., 0])
    done = x + solved
    done[~equations.solved] = np.nan
    scans = equations.scans
    return AgisSolution(
        done, h, len(history), bool(rested or work.residual < _SOLVED), np.array(history), np.array(updates), fit.modes, fit.formal,
        equations.formal, equations.solved, scans.lon, scans.lat, scans.frame,
        equations.motion.parameters((x + solved)[..., None])[:, 0] if equations.motion is not None else None,
    )  # fmt: skip


def _left(passes, along, across, x, attitude):
    """What parameters leave of the observations; no larger arrays than these two."""
    seen = passes.predict(x, attitude)
    for observed, predicted in zip((along, across), seen, strict=True):
        np.subtract(observed, predicted, out=predicted)
    return seen


def _held(equations, x):
    """What a global motion asks of parameters, (n, 5)."""
    out = np.zeros_like(x)
    if equations.motion is not None:
        out[:, 3:] = equations.motion.weights[:, None] * x[:, 3:] - equations.motion.pull(x[..., None])[..., 0]
    return out


def _moved(history, sigma):
    """By how many formal errors a low degree has moved in the last iterations, at most."""
    last = np.array(history[-REST - 1 :])
    return float(np.max(np.ptp(last, axis=0) / sigma))
