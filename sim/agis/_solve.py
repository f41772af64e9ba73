"""From observations to sources and attitude: the start, the iterations, when to stop."""

import hashlib
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sim.agis._globals import MotionFit
from sim.agis.results import AgisSolution
from vsh.tools.errors import CheckpointError
from vsh.tools.files import read_arrays, write_arrays
from vsh.tools.parallel import blas_for, progress_bar
from vsh.tools.types import FloatArray, PathName


class Iteration:
    """(S − C A⁻¹ Cᵀ) x = r step by step, for several right-hand sides at once.

    Sources and attitude solved in turn are a simple iteration with the preconditioner S⁻¹; with conjugate directions
    they are conjugate gradients with Gauss–Seidel's. The part of x along the null space stays what it was.
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


def key_of(things: Iterable[Any]) -> str:
    """A hash of arrays and plain values."""
    digest = hashlib.sha256()
    for thing in things:
        digest.update(np.ascontiguousarray(thing).tobytes() if isinstance(thing, np.ndarray) else repr(thing).encode())
    return digest.hexdigest()


def save(path: PathName, key: str, state: dict[str, Any]) -> None:
    """Write a state; whole, or not at all."""
    write_arrays(path, {"key": np.array(key)} | state)


def load(path: PathName, key: str) -> dict[str, Any] | None:
    """A state that was saved, or None where there is none."""
    if not Path(path).exists():
        return None
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise CheckpointError(f"{path} is damaged ({error}): delete it to begin anew") from error
    if str(arrays.pop("key", "")) != key:
        raise CheckpointError(f"{path} belongs to another solution: delete it to begin anew")
    return arrays


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
        of_sources, _ = passes.adjoint(along, across, x, attitude)
        x = x + equations.precondition((of_sources - _held(equations, x))[..., None])[..., 0]
    of_sources, of_attitude = passes.adjoint(along, across, x, np.zeros_like(attitude))
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
        done,
        h,
        len(history),
        bool(rested or work.residual < _SOLVED),
        np.array(history),
        np.array(updates),
        fit.modes,
        fit.formal,
        equations.formal,
        equations.solved,
        scans.lon,
        scans.lat,
        scans.frame,
        equations.motion.parameters((x + solved)[..., None])[:, 0] if equations.motion is not None else None,
    )


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
