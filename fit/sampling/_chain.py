"""A Markov chain on its way: from its start or from a checkpoint to its last step (emcee)."""

from __future__ import annotations

import time
from typing import Any

import emcee
import numpy as np

from fit.sampling._checkpoint import load, save
from vsh.checks.types import FloatArray, PathName
from vsh.errors import CheckpointError, ParameterError
from vsh.system.progress import progress_bar


def autocorrelation(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation times of a chain (steps, walkers, d), (d,); nan where a walker never moved. [steps]"""
    with np.errstate(invalid="ignore", divide="ignore"):
        return emcee.autocorr.integrated_time(chain, tol=0, quiet=True)


def split_r_hat(chain: FloatArray) -> FloatArray:
    """Split R̂ of each coordinate of a chain (steps, walkers, d), (d,): what the halves of all walkers differ by.

    Notes
    -----
    Gelman et al. (2013, Bayesian Data Analysis, 3rd ed., sect. 11.4). The walkers of an ensemble know of each other, which
    makes it a little too small.
    """
    half = len(chain) // 2
    halves = np.concatenate([chain[:half], chain[half : 2 * half]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        within, between = halves.var(axis=0, ddof=1).mean(0), halves.mean(axis=0).var(axis=0, ddof=1)
        return np.sqrt((half - 1) / half + between / within)


#: A chain shorter than this many autocorrelation times says nothing certain, not even about its length.
ENOUGH = 50
#: What a chain that is too short aims at: its own estimate of the autocorrelation time is too small.
_AIM = 75


class Run:
    """One chain: `resume_from` ties it to a checkpoint, `run` runs it.

    Moves are by differential evolution, one in ten of them from mode to mode. A chain that has fewer than 50
    autocorrelation times after `steps` goes on, to at most `most` steps. The chain does not depend on where it was
    interrupted, nor on how often it was saved.
    """

    def __init__(
        self, model: Any, begin: FloatArray, seed: int, steps: int, progress: bool, save_every: float, most: int = 0
    ) -> None:
        self.sampler = emcee.EnsembleSampler(
            *begin.shape, model.log_probability, vectorize=True,
            moves=[(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)],
        )  # fmt: skip
        first = model.log_probability(begin)
        if not np.isfinite(first).all():
            raise ParameterError(f"{(~np.isfinite(first)).sum()} of {len(begin)} walkers would start at zero density")
        self.state = emcee.State(begin, log_prob=first, random_state=np.random.RandomState(seed).get_state())
        self.start = begin, first
        self.steps, self.most = steps, max(steps, most)
        self.chain, self.log_probability = np.empty((steps, *begin.shape)), np.empty((steps, len(begin)))
        self.done = 0
        self.progress, self.save_every = progress, save_every
        self.path: PathName | None = None
        self.fingerprint: dict[str, str] = {}

    def resume_from(self, path: PathName, fingerprint: dict[str, str]) -> None:
        """Go on from a checkpoint, if it is there, and write to it from now on."""
        self.path, self.fingerprint = path, fingerprint | {"start": f"{self.start[1].sum():.17g}"}
        found = load(path, self.fingerprint)
        if found is None:
            return
        chain, log_probability, random_state = found
        if chain.shape[1:] != self.chain.shape[1:] or log_probability.shape != chain.shape[:2] or not len(chain):
            raise CheckpointError(f"{path} holds a chain of shape {chain.shape}: name another file, or delete it")
        self._make_room(len(chain))
        self.done = len(chain)
        self.chain[: self.done], self.log_probability[: self.done] = chain, log_probability
        self.state = emcee.State(chain[-1], log_prob=log_probability[-1], random_state=random_state)

    def run(self) -> tuple[FloatArray, FloatArray]:
        """Go to the last step; returns the chain and its log-probabilities."""
        target = self.steps
        while True:
            self._make_room(target)
            if target > self.done:
                self._go_on(target)
            if target >= self.most:
                break
            slowest = float(np.max(autocorrelation(self.chain[:target])))
            if target >= ENOUGH * slowest:
                break
            aim = _AIM * slowest if np.isfinite(slowest) else 4 * target
            target = int(min(self.most, max(1.5 * target, aim)))
        return self.chain[:target], self.log_probability[:target]

    def _make_room(self, steps):
        more = steps - len(self.chain)
        if more > 0:
            self.chain = np.concatenate([self.chain, np.empty((more, *self.chain.shape[1:]))])
            self.log_probability = np.concatenate([self.log_probability, np.empty((more, self.chain.shape[1]))])

    def _go_on(self, target):
        """To a step, saving on the way."""
        last, cost = time.monotonic(), 0.0
        bar = progress_bar(None, target, "chain", self.progress, " steps", initial=self.done)
        with bar:
            for state in self.sampler.sample(
                self.state, iterations=target - self.done, store=False, skip_initial_state_check=True
            ):
                self.chain[self.done], self.log_probability[self.done] = state.coords, state.log_prob
                self.done += 1
                self.state = state
                bar.update()
                # Long chains take long to write: never more than a twentieth of the time.
                if self.path and time.monotonic() - last > max(self.save_every, 20 * cost):
                    begun = time.monotonic()
                    self._save()
                    last = time.monotonic()
                    cost = last - begun
            if self.path:
                self._save()

    def _save(self):
        done = slice(0, self.done)
        state = self.sampler.random_state
        save(self.path, self.fingerprint, self.chain[done], self.log_probability[done], state)
