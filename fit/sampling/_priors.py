"""Prior densities of one number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Protocol

import numpy as np

from vsh.checks.notebook import InNotebook
from vsh.checks.types import FloatArray
from vsh.errors import ParameterError


class Prior(Protocol):
    """A prior density of one number.

    Attributes
    ----------
    low, high : float
        Limits, which may be infinite.
    proper : bool
        Whether its integral is finite.
    """

    @property
    def low(self) -> float:
        """The lower limit, perhaps −∞."""

    @property
    def high(self) -> float:
        """The upper limit, perhaps ∞."""

    @property
    def proper(self) -> bool:
        """Whether its integral is finite."""

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at x, any shape."""
        ...


def _limit(name, value):
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
            object.__setattr__(self, name, _limit(name, getattr(self, name)))
        if not self.low < self.high:
            raise ParameterError(f"a flat prior needs limits that rise, not {self.low} and {self.high}")

    @property
    def proper(self) -> bool:
        """Whether its integral is finite."""
        return bool(np.isfinite(self.high - self.low))

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at x, any shape."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -np.log(self.high - self.low) if self.proper else 0.0, -np.inf)


@dataclass(frozen=True)
class Normal(InNotebook):
    """A Gaussian, which may be cut off below (at zero, for what is positive)."""

    mean: float
    sigma: float
    low: float = -np.inf
    high: float = np.inf

    proper = True

    def __post_init__(self) -> None:
        for name in ("mean", "sigma", "low", "high"):
            object.__setattr__(self, name, _limit(name, getattr(self, name)))
        if not (self.sigma > 0 and np.isfinite(self.sigma) and np.isfinite(self.mean)):
            raise ParameterError(f"a Gaussian prior needs a finite mean and σ > 0, not {self.mean} ± {self.sigma}")

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at x, any shape, but for the constant that a cut-off adds."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -(((x - self.mean) / self.sigma) ** 2) / 2 - np.log(self.sigma), -np.inf)


@dataclass(frozen=True)
class Density(InNotebook):
    """Any density: a function that takes an array and returns log-densities, between two limits."""

    function: Callable[[FloatArray], FloatArray]
    low: float
    high: float

    proper = True

    def __repr__(self) -> str:
        return f"Density({named_function(self.function)}, {self.low}, {self.high})"

    def log(self, x: FloatArray) -> FloatArray:
        """Log-density at x, any shape."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, self.function(np.where(inside, x, (self.low + self.high) / 2)), -np.inf)


def integrable_over_cube(prior: Prior) -> bool:
    """Whether ∫ p(x)/x³ dx over x > 0 is finite at zero.

    Examples
    --------
    >>> integrable_over_cube(Flat(50.0, 80.0)), integrable_over_cube(Normal(67.3, 15.0))
    (True, False)
    """
    if prior.low > 0:
        return True
    # The share of each decade must fall: x p(x)/x³ from 1e-2 down to 1e-8 of the prior's own scale.
    scale = prior.high if np.isfinite(prior.high) else max(getattr(prior, "mean", 1.0), 1.0)
    x = scale * np.geomspace(1e-2, 1e-8, 7)
    with np.errstate(all="ignore"):
        share = prior.log(x) - 2 * np.log(x)
    return bool((np.diff(share) < -0.1).all() or np.isneginf(share).all())


def as_prior(value: Any, name: str, named: Mapping[str, Prior] | tuple[()] = ()) -> Any:
    """A prior of one positive number: a prior, a pair (mean, σ), or one of the names."""
    known = dict(named)
    if isinstance(value, str):
        if value not in known:
            raise ParameterError(f"no prior on {name} is called {value!r}; there are {', '.join(known)}")
        value = known[value]
    elif isinstance(value, tuple) and len(value) == 2:
        value = Normal(*value)
    if not all(hasattr(value, each) for each in ("log", "low", "high")):
        raise ParameterError(f"the prior on {name} must be Flat(low, high), Normal(mean, sigma), Density(f, low, high)")
    if not value.high > 0:
        raise ParameterError(f"the prior on {name} leaves nothing above zero: {value}")
    return value


def named_function(function: Callable[..., Any]) -> str:
    """The name of a function and a hash of what it does."""
    code = getattr(function, "__code__", None)
    mark = sha256(code.co_code + repr(code.co_consts).encode()).hexdigest()[:12] if code else ""
    return f"{getattr(function, '__qualname__', type(function).__name__)} {mark}".strip()
