"""What is known before of our velocity, of H0 and of the noise."""

from dataclasses import dataclass

import numpy as np

from fit.sampling import Flat, Normal, as_prior, integrable_over_cube, named_function
from vsh.cosmology import PLANCK_2018
from vsh.errors import ParameterError
from vsh.vector import Vector

#: Planck Collaboration (2020, A&A 641, A6): H0 from the microwave background. [km/s/Mpc]
PLANCK_HUBBLE = Normal(67.4, 0.5)
#: Where an infinite prior on H0 is cut off. [km/s/Mpc]
HUBBLE_LIMITS = 1.0, 1000.0
_HUBBLE_PRIORS = {"planck": PLANCK_HUBBLE, "flat": Flat(0.0)}


@dataclass(frozen=True)
class Priors:
    """What is known before, in one place.

    Attributes
    ----------
    velocity : VelocityPrior
    hubble : prior
    peculiar, extra : float or prior — fixed (σ_pec then for H_ref), or free
    """

    velocity: object
    hubble: object
    peculiar: object
    extra: object

    @property
    def free(self):
        """Names and priors of the free numbers besides the velocity; H0 comes first."""
        named = {"H0": self.hubble, "sigma_pec": self.peculiar, "sigma_extra": self.extra}
        return {name: prior for name, prior in named.items() if not isinstance(prior, float)}

    def limits(self, name):
        """The smallest and largest value of one of them that is ever asked for."""
        prior = {"H0": self.hubble, "sigma_pec": self.peculiar, "sigma_extra": self.extra}[name]
        if isinstance(prior, float):
            return prior, prior
        low, high = prior.low, prior.high
        if isinstance(prior, Normal):
            low, high = max(low, prior.mean - 8 * prior.sigma), min(high, prior.mean + 8 * prior.sigma)
        if name == "H0":
            return max(low, min(HUBBLE_LIMITS[0], high / 100)), min(high, HUBBLE_LIMITS[1])
        if not np.isfinite(high):
            raise ParameterError(f"the prior on {name} needs an upper limit: Flat(0, high)")
        return max(low, 0.0), high

    def log(self, values):
        """Summed log-density of the free numbers, (n,), from their columns (n, k)."""
        total = np.zeros(len(values))
        for column, (name, prior) in zip(values.T, self.free.items(), strict=True):
            low, high = self.limits(name)
            total += np.where((column >= low) & (column <= high), prior.log(column), -np.inf)
        return total

    def describe(self):
        """In words, for the fingerprint of a chain and for reports."""
        return {"velocity": self.velocity.name} | {
            name: repr(getattr(self, name)) for name in ("hubble", "peculiar", "extra")
        }


def priors(velocity, hubble, peculiar, extra, frame):
    """Priors as users give them, checked.

    Raises
    ------
    ParameterError
        If one is none, if neither bounds the ridge (flat for the velocity and without limits for H0), or if
        the posterior of H0 is not integrable.
    """
    velocity, hubble = velocity_prior(velocity, frame), as_prior(hubble, "H0", _HUBBLE_PRIORS)
    if not (velocity.proper or hubble.proper):
        raise ParameterError(
            "the data see only the product v · H0: with a flat prior on the velocity, that on H0 must be proper "
            "(Flat(low, high), Normal(mean, sigma)), or the other way round"
        )
    if velocity.name == "flat" and not integrable_over_cube(hubble):
        raise ParameterError(
            f"with a prior flat in the velocity the posterior of H0 goes as p(H0)/H0³, which for {hubble} has no integral: small H0 "
            'would win by where the sampler stops. Take velocity_prior="flat-product" (flat in v · H0: the prior on H0 comes '
            "back), or give H0 a lower limit, Normal(mean, sigma, low=…) or Flat(low, high)"
        )
    return Priors(velocity, hubble, _number_or_prior(peculiar, "peculiar"), _number_or_prior(extra, "extra"))


def _number_or_prior(value, name):
    if isinstance(value, (int, float, np.number)):
        if not 0 <= value < np.inf:
            raise ParameterError(f"{name} cannot be {value}: zero or more, or a prior, is wanted")
        return float(value)
    return as_prior(value, name)


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
        value = PLANCK_2018
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
        return VelocityPrior(f"function {named_function(value)}", function=value)
    raise ParameterError(f"a velocity prior is 'planck', 'flat', 'flat-product', a Vector or a function, not {value!r}")
