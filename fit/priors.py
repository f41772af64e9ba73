"""What was known before: prior densities of one number, and of a velocity."""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from vsh.apex import PLANCK
from vsh.errors import ParameterError
from vsh.vector import Vector


def _limit(name, value):
    """A number, which may be infinite; whole ones stay whole."""
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and value == value:  # noqa: PLR0124 (nan)
        return value
    raise ParameterError(f"{name} of a prior must be a number, not {value!r}")


@dataclass(frozen=True)
class Flat:
    """Equal density between two limits; improper (and then unnormalised) where one is infinite."""

    low: float
    high: float = np.inf

    def __post_init__(self):
        for name in ("low", "high"):
            object.__setattr__(self, name, _limit(name, getattr(self, name)))
        if not self.low < self.high:
            raise ParameterError(f"a flat prior needs limits that rise, not {self.low} and {self.high}")

    @property
    def proper(self):
        return bool(np.isfinite(self.high - self.low))

    def log(self, x):
        """Log-density at x, any shape."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -np.log(self.high - self.low) if self.proper else 0.0, -np.inf)


@dataclass(frozen=True)
class Normal:
    """A Gaussian, which may be cut off below (at zero, for what is positive)."""

    mean: float
    sigma: float
    low: float = -np.inf
    high: float = np.inf

    proper = True

    def __post_init__(self):
        for name in ("mean", "sigma", "low", "high"):
            object.__setattr__(self, name, _limit(name, getattr(self, name)))
        if not (self.sigma > 0 and np.isfinite(self.sigma) and np.isfinite(self.mean)):
            raise ParameterError(f"a Gaussian prior needs a finite mean and σ > 0, not {self.mean} ± {self.sigma}")

    def log(self, x):
        """Log-density at x, any shape, but for the constant that a cut-off adds."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -(((x - self.mean) / self.sigma) ** 2) / 2 - np.log(self.sigma), -np.inf)


@dataclass(frozen=True)
class Density:
    """Any density: a function that takes an array and returns log-densities, between two limits."""

    function: callable
    low: float
    high: float

    proper = True

    def __repr__(self):
        return f"Density({_named(self.function)}, {self.low}, {self.high})"

    def log(self, x):
        """Log-density at x, any shape."""
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, self.function(np.where(inside, x, (self.low + self.high) / 2)), -np.inf)


#: Planck Collaboration (2020, A&A 641, A6): H0 from the microwave background. [km/s/Mpc]
PLANCK_HUBBLE = Normal(67.4, 0.5)


def integrable_over_cube(prior):
    """Whether ∫ p(x)/x³ dx over x > 0 is finite at zero.

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


def as_prior(value, name, named=()):
    """A prior of one positive number: a prior, a pair (mean, σ), or one of the names.

    Raises
    ------
    ParameterError
        If it is none of these, or bears on no positive number.
    """
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


@dataclass(frozen=True, eq=False)
class VelocityPrior:
    """Density of our velocity along the axes of one frame.

    Attributes
    ----------
    mean, precision : (3,) and (3, 3) arrays or None — of a Gaussian; None for others [km/s]
    function : callable or None — (n, 3) km/s → (n,) log-densities
    name : str
        For the fingerprint of a chain.
    words : str
        For reports.
    """

    name: str
    mean: np.ndarray = None
    precision: np.ndarray = None
    function: callable = None
    words: str = ""

    @property
    def proper(self):
        return self.name not in ("flat", "flat-product")

    @property
    def in_product(self):
        """Whether the density is flat in u = v H0, not in v: p(v, H0) = p(H0) H0³."""
        return self.name == "flat-product"

    @property
    def gaussian(self):
        """Whether it is a Gaussian, the flat one (precision zero) among them."""
        return self.function is None

    def log(self, v):
        """Log-density at velocities v, (n, 3)."""
        if self.function is not None:
            return np.asarray(self.function(v), float)
        away = v - self.mean
        _, logdet = np.linalg.slogdet(self.precision) if self.proper else (1, 0.0)
        return (logdet - np.einsum("ni,ij,nj->n", away, self.precision, away)) / 2


def velocity_prior(value, frame):
    """A velocity prior along the axes of `frame`.

    Parameters
    ----------
    value : "planck", "flat", "flat-product", a Vector in km/s with its covariance, or a function from
        velocities (n, 3), along the axes of `frame`, to log-densities (n,)

    Raises
    ------
    ParameterError
        If it is none of these, or a Vector without errors.
    """
    if isinstance(value, str) and value in ("flat", "flat-product"):
        return VelocityPrior(value, np.zeros(3), np.zeros((3, 3)))
    if isinstance(value, str) and value == "planck":
        value = PLANCK
    if isinstance(value, Vector):
        turned = value.to_frame(frame)
        if not np.linalg.eigvalsh(turned.covariance)[0] > 0:
            raise ParameterError("a Gaussian prior on the velocity needs errors in all three components")
        precision = np.linalg.inv(turned.covariance)
        l, b = value.to_frame("galactic").direction
        words = f"{value.amplitude:.2f} ± {value.amplitude_error:.2g} km/s toward l = {l:.2f}°, b = {b:+.2f}°"
        return VelocityPrior(
            f"Gaussian {value.value} {value.sigma} {value.frame}", turned.value, precision, words=words
        )
    if callable(value):
        return VelocityPrior(f"function {_named(value)}", function=value)
    raise ParameterError(f"a velocity prior is 'planck', 'flat', 'flat-product', a Vector or a function, not {value!r}")


def _named(function):
    """The name of a function and a hash of what it does."""
    code = getattr(function, "__code__", None)
    mark = sha256(code.co_code + repr(code.co_consts).encode()).hexdigest()[:12] if code else ""
    return f"{getattr(function, '__qualname__', type(function).__name__)} {mark}".strip()
