"""What is known before of our velocity, of H0 and of the noise."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from fit.posterior._sampling import Flat, Normal, Prior, identify_function, is_integrable_with_inverse_cube, make_prior
from fit.secular_parallax import ASSUMED, DistanceModel, LocalGroup
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.tools.digits import format_with_error
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class VelocityPrior:
    """Density of our velocity along the axes of one frame."""

    name: str
    mean: FloatArray = field(default_factory=lambda: np.zeros(3))
    precision: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    function: Callable[[FloatArray], FloatArray] | None = None
    words: str = ""

    @property
    def proper(self) -> bool:
        """Return whether its integral is finite."""
        return self.name not in ("flat", "flat-product")

    @property
    def flat_in_product(self) -> bool:
        """Return whether the density is flat in u = v H0, not in v: p(v, H0) = p(H0) H0³."""
        return self.name == "flat-product"

    @property
    def gaussian(self) -> bool:
        """Return whether it is a Gaussian, the flat one (precision zero) among them."""
        return self.function is None

    def log(self, v: FloatArray) -> FloatArray:
        """Log-density at velocities v, (n, 3)."""
        if self.function is not None:
            return np.asarray(self.function(v), float)
        offset = v - self.mean
        _, logdet = np.linalg.slogdet(self.precision) if self.proper else (1, 0.0)
        return (logdet - np.einsum("ni,ij,nj->n", offset, self.precision, offset)) / 2


def make_velocity_prior(value: Any, frame: str) -> VelocityPrior:
    """A velocity prior along the axes of `frame`."""
    if isinstance(value, str) and value in ("flat", "flat-product"):
        return VelocityPrior(value, np.zeros(3), np.zeros((3, 3)))
    if isinstance(value, str) and value == "planck":
        value = CMB_VELOCITY_PLANCK18
    if isinstance(value, Vector):
        vector = value.to_frame(frame)
        if not np.linalg.eigvalsh(vector.covariance)[0] > 0:
            raise ParameterError("a Gaussian prior on the velocity needs errors in all three components")
        precision = np.asarray(np.linalg.inv(vector.covariance), float)
        l, b = value.to_frame("galactic").direction
        text = f"{format_with_error(value.amplitude, value.amplitude_error)} km/s toward l = {l:.2f}°, b = {b:+.2f}°"
        return VelocityPrior(f"Gaussian {value.value} {value.sigma} {value.frame}", vector.value, precision, words=text)
    if callable(value):
        return VelocityPrior(f"function {identify_function(value)}", function=value)
    raise ParameterError(f"a velocity prior is 'planck', 'flat', 'flat-product', a Vector or a function, not {value!r}")


#: Planck Collaboration (2020, A&A 641, A6): H0 from the microwave background. [km/s/Mpc]
PLANCK_HUBBLE = Normal(67.4, 0.5)
#: Where an infinite prior on H0 is cut off. [km/s/Mpc]
HUBBLE_LIMITS = 1.0, 1000.0
_HUBBLE_PRIORS: dict[str, Prior] = {"planck": PLANCK_HUBBLE, "flat": Flat(0.0)}
#: Units of the quantities of a posterior.
UNITS = {
    "v_x": "km/s", "v_y": "km/s", "v_z": "km/s", "speed": "km/s", "H0": "km/s/Mpc", "peculiar_dispersion": "km/s",
    "excess_noise": "µas/yr", "flow_amplitude": "",
    "a_x": "µas/yr", "a_y": "µas/yr", "a_z": "µas/yr", "omega_x": "µas/yr", "omega_y": "µas/yr", "omega_z": "µas/yr",
}  # fmt: skip
#: Names that are too long for the table.
SHORT_NAMES = {"peculiar_dispersion": "dispersion"}
#: The same as standards for tables want them.
FITS_UNITS = {"km/s": "km / s", "km/s/Mpc": "km / (Mpc s)", "µas/yr": "uas / yr"}


@dataclass(frozen=True)
class Priors(InNotebook):
    """Priors of a posterior, as users give them.

    Attributes
    ----------
    velocity : "planck", "flat", "flat-product", Vector with covariance [km/s], or a function
        "flat" is flat in v: p(H0) then goes as its prior over H0³, and a prior on H0 for which that has no
        integral is refused. "flat-product" is flat in u = v H0, which is what the data see: the prior on H0
        comes back. A function takes velocities (n, 3) along the field's axes and returns log-densities (n,).
    hubble : "planck", "flat", (mean, σ), Flat, Normal or Density
        [km/s/Mpc] "flat" has no upper limit; the chain stays below 1000. One that is given is kept.
    peculiar_dispersion : float or prior, optional
        Dispersion of peculiar velocities in each component, beside the flow where one is fitted: 750 unless given, 150
        with flows. [km/s] Fixed, it enters the weights alone, for the cosmology's H0; with a prior, the scatter of the
        galaxies bears on the product of dispersion and H0, and so, as far as the dispersion is known, on H0. Redshifts
        scatter by it, or by the prior's mean.
    flow_amplitude : prior, optional
        On the size of the flow, one for the theory's own fσ8. The flow that is seen then bears on H0; without, its
        amplitudes stand for the cosmology's H0 and weigh only.
    local_group : Vector or bool, optional
        The Local Group's velocity in the microwave background, which tells the flow where we are; True for that of
        Kogut et al. (1993). [km/s] Without it H0 is too low where we move with the galaxies nearby, as we do.
    acceleration : Vector, optional
        Known from elsewhere, from quasars say; free unless given. [µas/yr]
    excess_noise : float or prior
        Noise beyond the catalogue's in each component, fixed or free. [µas/yr]
    spin : None, "free" or Vector
        No spin; a flat prior; or a Gaussian one. [µas/yr]
    """

    velocity: str | Vector | Callable[[FloatArray], FloatArray] = "planck"
    hubble: str | tuple[float, float] | Prior = "flat"
    peculiar_dispersion: float | Prior | None = None
    excess_noise: float | Prior = 0.0
    spin: Literal["free"] | Vector | None = None
    flow_amplitude: Prior | tuple[float, float] | None = None
    local_group: Vector | bool | None = None
    acceleration: Vector | None = None


def make_priors(
    velocity_prior: str | Vector | Callable[[FloatArray], FloatArray] | None,
    hubble_prior: str | tuple[float, float] | Prior | None,
    options: dict[str, Any],
) -> Priors:
    """The Priors that `sample` and `grid` were given one by one."""
    given_priors = {"velocity": velocity_prior, "hubble": hubble_prior} | options
    assumed = ASSUMED - {"peculiar_dispersion"}  # which may have a prior
    given_priors = {name: value for name, value in given_priors.items() if value is not None and name not in assumed}
    invalid_names = set(given_priors) - set(Priors.__dataclass_fields__)
    if invalid_names:
        raise ParameterError(f"no prior is called {', '.join(sorted(invalid_names))}; there are those of Priors")
    return Priors(**given_priors)


#: What may be fixed or free besides the velocity and H0.
_NUISANCE_NAMES = ("peculiar_dispersion", "excess_noise", "flow_amplitude")


@dataclass(frozen=True)
class ModelPriors:
    """Priors of a model, checked, along the axes of one frame."""

    velocity: VelocityPrior
    hubble: Prior
    peculiar_dispersion: float | Prior
    excess_noise: float | Prior
    flow_amplitude: float | Prior = 1.0
    acceleration: Vector | None = None
    flows: str = "none that galaxies share"
    group: LocalGroup | None = None

    @property
    def free(self) -> dict[str, Prior]:
        """Names and priors of the free numbers besides the velocity; H0 comes first."""
        return {name: prior for name, prior in self._collect_priors_by_name().items() if not isinstance(prior, float)}

    def limits(self, name: str) -> tuple[float, float]:
        """The smallest and largest value of one of them that is ever asked for."""
        prior = self._collect_priors_by_name()[name]
        if isinstance(prior, float):
            return prior, prior
        lower, upper = prior.low, prior.high
        if isinstance(prior, Normal):
            lower, upper = max(lower, prior.mean - 8 * prior.sigma), min(upper, prior.mean + 8 * prior.sigma)
        if name == "H0":
            return max(lower, min(HUBBLE_LIMITS[0], upper / 100)), upper if np.isfinite(upper) else HUBBLE_LIMITS[1]
        if not np.isfinite(upper):
            raise ParameterError(f"the prior on {name} needs an upper limit: Flat(0, high)")
        return max(lower, 0.0), upper

    def log(self, values: FloatArray) -> FloatArray:
        """Summed log-density of the free numbers, (n,), from their columns (n, k)."""
        log_density = np.zeros(len(values))
        for column, (name, prior) in zip(values.T, self.free.items(), strict=True):
            lower, upper = self.limits(name)
            log_density += np.where((column >= lower) & (column <= upper), prior.log(column), -np.inf)
        return log_density

    def _collect_priors_by_name(self):
        return {"H0": self.hubble} | {name: getattr(self, name) for name in _NUISANCE_NAMES}

    @property
    def typical_dispersion(self) -> float:
        """The dispersion of peculiar velocities, or the mean of its prior. [km/s]"""
        prior = self.peculiar_dispersion
        if isinstance(prior, float):
            return prior
        lower, upper = self.limits("peculiar_dispersion")
        return prior.mean if isinstance(prior, Normal) else (lower + upper) / 2

    def describe_exactly(self) -> dict[str, str]:
        """Describe them to the last digit, for the fingerprint of a chain."""
        return (
            {"velocity": self.velocity.name}
            | {name: repr(getattr(self, name)) for name in ("hubble", *_NUISANCE_NAMES, "acceleration")}
            | ({} if self.group is None else {"local group": f"{self.group.velocity} {self.group.covariance}"})
        )

    def describe_in_words(self) -> dict[str, str]:
        """Describe them for reports."""
        return {"velocity": self.velocity.words or self.velocity.name, "flows": self.flows} | {
            name: _describe_prior(getattr(self, name)) for name in ("hubble", *_NUISANCE_NAMES)
        }


def _describe_prior(prior):
    if isinstance(prior, Flat):
        return f"flat from {prior.low:g} to {prior.high:g}"
    if isinstance(prior, Normal):
        has_limits = np.isfinite([prior.low, prior.high]).any()
        return f"{prior.mean:g} ± {prior.sigma:g}" + (f", from {prior.low:g} to {prior.high:g}" if has_limits else "")
    return f"{prior:g}" if isinstance(prior, float) else repr(prior)


def check_priors(priors: Priors, frame: str, distance_model: DistanceModel | None = None) -> ModelPriors:
    """Priors as users give them, checked: ModelPriors."""
    velocity = make_velocity_prior(priors.velocity, frame)
    hubble = make_prior(priors.hubble, "H0", _HUBBLE_PRIORS)
    if not (velocity.proper or hubble.proper):
        raise ParameterError(
            "the data constrain only the product v · H0: with a flat prior on the velocity, that on H0 must be proper "
            "(Flat(low, high), Normal(mean, sigma)), or the other way round"
        )
    if velocity.name == "flat" and not is_integrable_with_inverse_cube(hubble):
        raise ParameterError(
            f"with a prior flat in the velocity the posterior of H0 goes as p(H0)/H0³, which for {hubble} has no"
            ' integral: small H0 would dominate it. Take velocity_prior="flat-product" (flat in v · H0: the prior on'
            " H0 comes back), or give H0 a lower limit, Normal(mean, sigma, low=…) or Flat(low, high)"
        )
    dispersion = priors.peculiar_dispersion
    if dispersion is None or isinstance(dispersion, (int, float, np.number)):
        fixed_dispersion = None if dispersion is None else _check_fixed_or_prior(dispersion, "peculiar_dispersion")
        dispersion = replace(distance_model or DistanceModel(), peculiar_dispersion=fixed_dispersion).dispersion
    amplitude = priors.flow_amplitude
    return ModelPriors(
        velocity,
        hubble,
        _check_fixed_or_prior(dispersion, "peculiar_dispersion"),
        _check_fixed_or_prior(priors.excess_noise, "excess_noise"),
        1.0 if amplitude is None else make_prior(amplitude, "flow_amplitude"),
        None if priors.acceleration is None else priors.acceleration.to_frame(frame),
    )


def _check_fixed_or_prior(value, quantity):
    if isinstance(value, (int, float, np.number)):
        if not 0 <= value < np.inf:
            raise ParameterError(f"{quantity} cannot be {value}: zero or more, or a prior, is expected")
        return float(value)
    return make_prior(value, quantity)
