"""Priors, chains and checkpoints, for any posterior."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol

import emcee
import numpy as np

from vsh.tools.errors import CheckpointError, ParameterError
from vsh.tools.files import check_not_read, digest_values, read_arrays, write_arrays
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import import_quietly
from vsh.tools.types import ArrayLike, FloatArray, PathName


class Prior(Protocol):
    """A prior density of one number."""

    @property
    def low(self) -> float:
        """The lower limit, perhaps −∞."""

    @property
    def high(self) -> float:
        """The upper limit, perhaps ∞."""

    @property
    def proper(self) -> bool:
        """Return whether its integral is finite."""

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at `x`, any shape."""
        ...


def _check_prior_number(name, value):
    """A number, which may be infinite; whole ones stay whole."""
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and value == value:
        return value
    raise ParameterError(f"{name} of a prior must be a number, not {value!r}")


@dataclass(frozen=True)
class Flat(InNotebook):
    """Equal density between two limits; improper (and then unnormalised) where one is infinite."""

    low: float
    high: float = np.inf

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, _check_prior_number(name, getattr(self, name)))
        if not self.low < self.high:
            raise ParameterError(f"a flat prior needs limits that rise, not {self.low} and {self.high}")

    @property
    def proper(self) -> bool:
        """Return whether its integral is finite."""
        return bool(np.isfinite(self.high - self.low))

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at `x`, any shape."""
        is_inside = (x >= self.low) & (x <= self.high)
        return np.where(is_inside, -np.log(self.high - self.low) if self.proper else 0.0, -np.inf)


@dataclass(frozen=True)
class Normal(InNotebook):
    """A Gaussian, which may be cut off below (at zero, for what is positive) and above."""

    mean: float
    sigma: float
    low: float = -np.inf
    high: float = np.inf

    proper = True

    def __post_init__(self) -> None:
        for name in ("mean", "sigma", "low", "high"):
            object.__setattr__(self, name, _check_prior_number(name, getattr(self, name)))
        if not (self.sigma > 0 and np.isfinite(self.sigma) and np.isfinite(self.mean)):
            raise ParameterError(f"a Gaussian prior needs a finite mean and σ > 0, not {self.mean} ± {self.sigma}")

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at `x`, of any shape, up to a constant."""
        is_inside = (x >= self.low) & (x <= self.high)
        return np.where(is_inside, -(((x - self.mean) / self.sigma) ** 2) / 2 - np.log(self.sigma), -np.inf)


@dataclass(frozen=True)
class Density(InNotebook):
    """Any density: a function that takes an array and returns log-densities, between two limits."""

    function: Callable[[FloatArray], FloatArray]
    low: float
    high: float

    proper = True

    def __repr__(self) -> str:
        return f"Density({identify_function(self.function)}, {self.low}, {self.high})"

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at `x`, any shape."""
        is_inside = (x >= self.low) & (x <= self.high)
        return np.where(is_inside, self.function(np.where(is_inside, x, (self.low + self.high) / 2)), -np.inf)


def is_integrable_with_inverse_cube(prior: Prior) -> bool:
    """Return whether ∫ p(x)/x³ dx over x > 0 is finite at zero."""
    if prior.low > 0:
        return True
    # The share of each decade must fall: x p(x)/x³ from 1e-2 down to 1e-8 of the prior's own scale.
    scale = prior.high if np.isfinite(prior.high) else max(getattr(prior, "mean", 1.0), 1.0)
    x = scale * np.geomspace(1e-2, 1e-8, 7)
    with np.errstate(all="ignore"):
        log_share = prior.log(x) - 2 * np.log(x)
    return bool((np.diff(log_share) < -0.1).all() or np.isneginf(log_share).all())


def make_prior(value: Any, name: str, known_priors: Mapping[str, Prior] | tuple[()] = ()) -> Any:
    """A prior of one positive number: a prior, a pair (mean, σ), or one of the names."""
    priors = dict(known_priors)
    if isinstance(value, str):
        if value not in priors:
            raise ParameterError(f"no prior on {name} is called {value!r}; there are {', '.join(priors)}")
        value = priors[value]
    elif isinstance(value, tuple) and len(value) == 2:
        value = Normal(*value)
    if not all(hasattr(value, attribute) for attribute in ("log", "low", "high")):
        raise ParameterError(f"the prior on {name} must be Flat(low, high), Normal(mean, sigma), Density(f, low, high)")
    if not value.high > 0:
        raise ParameterError(f"the prior on {name} leaves nothing above zero: {value}")
    return value


def identify_function(function: Callable[..., Any]) -> str:
    """The name of a function and a hash of what it does."""
    code = getattr(function, "__code__", None)
    code_hash = sha256(code.co_code + repr(code.co_consts).encode()).hexdigest()[:12] if code else ""
    return f"{getattr(function, '__qualname__', type(function).__name__)} {code_hash}".strip()


_RANDOM_STATE_FIELDS = ("key", "position", "has_gauss", "gauss")


def make_fingerprint(arrays: Iterable[ArrayLike], data_label: str, model_words: dict[str, str]) -> dict[str, str]:
    """Fingerprint of a chain: a hash of the data, and the model in words."""
    return {"data": f"{data_label}, {digest_values(map(np.asarray, arrays))[:16]}"} | model_words


def save_chain(
    path: PathName, fingerprint: dict[str, str], chain: FloatArray, log_probability: FloatArray, state: Any
) -> None:
    """Write a chain (steps, walkers, d), its log-densities and the state of its random numbers."""
    arrays = {"chain": chain, "log_probability": log_probability}
    arrays |= {name: np.asarray(value) for name, value in zip(_RANDOM_STATE_FIELDS, state[1:], strict=True)}
    identity = {"fingerprint": np.frombuffer(json.dumps(fingerprint).encode(), np.uint8)}
    write_arrays(path, identity | arrays, overwrite=True)


def load_chain(path: PathName, fingerprint: dict[str, str]) -> tuple[FloatArray, FloatArray, Any] | None:
    """Read a chain back: chain, log-densities, state of the random numbers; None where there is no file."""
    path = Path(path)
    if not path.exists():
        return None
    try:
        arrays = read_arrays(path)
        file_fingerprint = json.loads(bytes(arrays["fingerprint"]).decode())
        chain, log_probability = arrays["chain"], arrays["log_probability"]
        state = ("MT19937", *(arrays[name] if name == "key" else arrays[name].item() for name in _RANDOM_STATE_FIELDS))
    except Exception as error:  # whatever a damaged file makes of zip and NumPy's headers
        raise CheckpointError(
            f"{path} is no chain of this program, or damaged ({type(error).__name__}): name another file, or delete it"
        ) from error
    mismatches = [
        key for key in sorted({*fingerprint, *file_fingerprint}) if fingerprint.get(key) != file_fingerprint.get(key)
    ]
    if mismatches:
        differences = "; ".join(
            f"{key}: there {file_fingerprint.get(key)}, here {fingerprint.get(key)}" for key in mismatches
        )
        raise CheckpointError(f"{path} holds a chain of another run ({differences}): name another file, or delete it")
    return chain, log_probability, state


def check_checkpoint_writable(path: PathName) -> None:
    """Raise CheckpointError before the work, not after it."""
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise CheckpointError(f"{path}: there is no such folder")
    if not os.access(folder, os.W_OK) or Path(path).is_dir():
        raise CheckpointError(f"{path} cannot be written")
    check_not_read(path, f"the checkpoint {path}")


def autocorrelate_chains(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation times of a chain (steps, walkers, d), (d,); nan where a walker never moved. [steps]

    One at least: independent samples scatter about it.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.maximum(emcee.autocorr.integrated_time(chain, tol=0, quiet=True), 1.0)


def compute_split_r_hat(chain: FloatArray) -> FloatArray:
    """Split R̂ of each coordinate of a chain (steps, walkers, d), (d,): what the halves of all walkers differ by.

    Notes
    -----
    Gelman et al. (2013, Bayesian Data Analysis, 3rd ed., sect. 11.4). The walkers of an ensemble know of each other,
    which makes it a little too small.
    """
    half = len(chain) // 2
    halves = np.concatenate([chain[:half], chain[half : 2 * half]], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        within_variance, between_variance = halves.var(axis=0, ddof=1).mean(0), halves.mean(axis=0).var(axis=0, ddof=1)
        return np.sqrt((half - 1) / half + between_variance / within_variance)


#: A chain shorter than this many autocorrelation times says nothing certain, not even about its length.
ENOUGH = 50
#: What a chain that is too short aims at: its own estimate of the autocorrelation time is too small.
_AIMED_TIMES = 75


#: The share of moves to an independent draw, where there is one: the rest would find what the draws do not know.
_DRAW_SHARE = 0.8


class Run:
    """A chain: `resume_from` ties it to a checkpoint, `run` runs it.

    Moves are by differential evolution, one in ten of them from mode to mode; where `propose` gives draws of nearly the
    posterior itself, four of five are to such a draw. A chain that has fewer than 50 autocorrelation times after
    `steps` goes on, to at most `most` steps. The chain does not depend on where it was interrupted, nor on how often it
    was saved.
    """

    def __init__(
        self,
        model: Any,
        start: FloatArray,
        seed: int,
        steps: int,
        progress: bool,
        save_every: float,
        max_steps: int = 0,
        propose: Callable[..., Any] | None = None,
    ) -> None:
        moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)]
        if propose is not None:
            moves = [(emcee.moves.MHMove(propose), _DRAW_SHARE)] + [(move, (1 - _DRAW_SHARE) * w) for move, w in moves]
        self.sampler = emcee.EnsembleSampler(*start.shape, model.log_probability, vectorize=True, moves=moves)
        log_density = model.log_probability(start)
        if not np.isfinite(log_density).all():
            raise ParameterError(f"{(~np.isfinite(log_density)).sum()} of {len(start)} walkers start at zero density")
        self.state = emcee.State(start, log_prob=log_density, random_state=np.random.RandomState(seed).get_state())
        self.start = start, log_density
        self.steps, self.max_steps = steps, max(steps, max_steps)
        self.chain, self.log_probability = (np.empty((steps, *start.shape)), np.empty((steps, len(start))))
        self.n_done = 0
        self.progress, self.save_every = progress, save_every
        self.path: PathName | None = None
        self.fingerprint: dict[str, str] = {}

    def resume_from(self, path: PathName, fingerprint: dict[str, str]) -> None:
        """Go on from a checkpoint, if it is there, and write to it from now on."""
        self.path, self.fingerprint = path, fingerprint | {"start": f"{self.start[1].sum():.17g}"}
        checkpoint = load_chain(path, self.fingerprint)
        if checkpoint is None:
            return
        chain, log_probability, random_state = checkpoint
        if chain.shape[1:] != self.chain.shape[1:] or log_probability.shape != chain.shape[:2] or not len(chain):
            raise CheckpointError(f"{path} holds a chain of shape {chain.shape}: name another file, or delete it")
        self._make_room_for(len(chain))
        self.n_done = len(chain)
        self.chain[: self.n_done], self.log_probability[: self.n_done] = chain, log_probability
        self.state = emcee.State(chain[-1], log_prob=log_probability[-1], random_state=random_state)

    def run(self) -> tuple[FloatArray, FloatArray]:
        """Go to the last step; returns the chain and its log-probabilities."""
        n_steps = self.steps
        while True:
            self._make_room_for(n_steps)
            if n_steps > self.n_done:
                self._sample_until_step(n_steps)
            if n_steps >= self.max_steps:
                break
            longest_time = float(np.max(autocorrelate_chains(self.chain[:n_steps])))
            if n_steps >= ENOUGH * longest_time:
                break
            aimed_steps = _AIMED_TIMES * longest_time if np.isfinite(longest_time) else 4 * n_steps
            n_steps = int(min(self.max_steps, max(1.5 * n_steps, aimed_steps)))
        return self.chain[:n_steps], self.log_probability[:n_steps]

    def _make_room_for(self, steps):
        extra_steps = steps - len(self.chain)
        if extra_steps > 0:
            self.chain = np.concatenate([self.chain, np.empty((extra_steps, *self.chain.shape[1:]))])
            self.log_probability = np.concatenate([self.log_probability, np.empty((extra_steps, self.chain.shape[1]))])

    def _sample_until_step(self, last_step):
        """Run to a step, saving on the way."""
        last_save_time, save_duration = time.monotonic(), 0.0
        bar = progress_bar(None, last_step, "chain", self.progress, " steps", initial=self.n_done)
        with bar:
            for state in self.sampler.sample(
                self.state, iterations=last_step - self.n_done, store=False, skip_initial_state_check=True
            ):
                self.chain[self.n_done], self.log_probability[self.n_done] = state.coords, state.log_prob
                self.n_done += 1
                self.state = state
                bar.update()
                # Long chains take long to write: never more than a twentieth of the time.
                if self.path and time.monotonic() - last_save_time > max(self.save_every, 20 * save_duration):
                    save_start = time.monotonic()
                    self._save_checkpoint()
                    last_save_time = time.monotonic()
                    save_duration = last_save_time - save_start
            if self.path:
                self._save_checkpoint()

    def _save_checkpoint(self):
        rows = slice(0, self.n_done)
        state = self.sampler.random_state
        assert self.path is not None
        save_chain(self.path, self.fingerprint, self.chain[rows], self.log_probability[rows], state)


_AXES = ("x", "y", "z")


def make_inference_data(
    samples: Mapping[str, FloatArray], log_probability: FloatArray | None, frame: str, units: Mapping[str, str]
) -> Any:
    """arviz' InferenceData (its DataTree from version 1 on) of samples, each (chains, draws)."""
    try:
        arviz = import_quietly("arviz")
    except ImportError:
        raise ImportError("arviz is not installed: pip install 'vsh-astrometry[arviz]'") from None
    variables = dict(samples)
    attributes = {name: {"unit": units.get(name, "")} for name in variables}
    for vector, letter in (("velocity", "v"), ("acceleration", "a")):
        components = [f"{letter}_{axis}" for axis in _AXES]
        if set(components) <= set(samples):
            variables[vector] = np.stack([samples[component] for component in components], axis=-1)
            attributes[vector] = {"unit": units.get(components[0], ""), "frame": frame}
    vector_names = [name for name, values in variables.items() if np.ndim(values) == 3]
    layout = {"coords": {"axis": list(_AXES)}, "dims": {name: ["axis"] for name in vector_names}}
    groups: dict[str, Any] = {"posterior": variables}
    groups |= {} if log_probability is None else {"sample_stats": {"lp": log_probability}}
    has_datatree = int(arviz.__version__.split(".")[0]) >= 1
    inference_data = arviz.from_dict(groups, **layout) if has_datatree else arviz.from_dict(**groups, **layout)
    for name, variable_attributes in attributes.items():
        inference_data["posterior"][name].attrs.update(variable_attributes)
    return inference_data
