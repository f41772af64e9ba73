"""The same posterior where a fraction of the sources is not to be trusted.

Each source's motion comes from its own error ellipse with probability 1 − f, or, with
probability f, from one widened by B in each axis. Nothing can be summed beforehand: a sample
costs one look at every source, and ã (and ω, if free) are sampled with the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fit.posterior._model import ParallaxModel
from fit.posterior._priors import ModelPriors
from fit.sampling import Prior
from fit.secular_parallax import OMEGA, A, ParallaxEquations
from vsh.checks.types import FloatArray
from vsh.errors import ParameterError
from vsh.system.parallel import map_blocks
from vsh.vector import Vector

_BLOCK = 2**12


@dataclass(frozen=True, eq=False)
class MixtureModel:
    """The posterior of (u, H0, …, outlier_fraction, ã[, ω]).

    Attributes
    ----------
    base : ParallaxModel
        Of the same data without outliers: priors, and the start.
    rows : ParallaxEquations
    fraction : prior
        Of f.
    width : float
        B [µas/yr]
    spin : None or "free"
    threads : int or None
    """

    base: ParallaxModel
    rows: ParallaxEquations
    fraction: Prior
    width: float
    spin: Literal["free"] | Vector | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        if not (self.fraction.low >= 0 and self.fraction.high <= 1):
            raise ParameterError(f"a fraction lies between 0 and 1, not between the limits of {self.fraction}")
        if self.rows.modes is not None or self.priors.acceleration is not None:
            raise ParameterError(
                "with outliers every source is for itself: neither flows nor a known acceleration can be taken"
            )
        if self.spin not in (None, "free"):
            raise ParameterError("with outliers the spin is None or 'free': take a known one away from the field first")

    @property
    def priors(self) -> ModelPriors:
        """Those of the model without outliers."""
        return self.base.priors

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates."""
        spin = ("omega_x", "omega_y", "omega_z") if self.spin == "free" else ()
        return (*self.base.names, "outlier_fraction", "a_x", "a_y", "a_z", *spin)

    def log_probability(self, theta: FloatArray) -> FloatArray:
        """Log posterior density of coordinates (n, d), up to a constant."""
        k = len(self.base.names)
        numbers, fraction, linear = theta[:, 3:k], theta[:, k], theta[:, k + 1 :]
        with np.errstate(invalid="ignore"):
            total = self.priors.log(numbers) + self.fraction.log(fraction)
        good = np.isfinite(total) & (fraction > 0) & (fraction < 1)
        if good.any():
            (spread, excess_noise, _), ratio = self.base.spreads(numbers[good])
            parameters = np.zeros((good.sum(), 9))
            parameters[:, :3], v = self.base.velocities(theta[good])
            parameters[:, A.start : A.start + linear.shape[1]] = linear[good]
            total[good] += self._log_likelihood(parameters, spread, excess_noise, fraction[good])
            total[good] += self.priors.velocity.log(v) + self.base.log_jacobian(ratio)
        total[~good] = -np.inf
        return np.where(np.isnan(total), -np.inf, total)

    def _log_likelihood(self, parameters, spread, excess_noise, fraction):
        n = len(self.rows.motion) // 2

        def block(part):
            both = np.r_[np.arange(part.start, part.stop), np.arange(part.start, part.stop) + n]
            residual = (self.rows.motion[both] - parameters @ self.rows.design[both].T) ** 2
            variance = (
                self.rows.variance[both]
                + self.rows.left[both]
                + excess_noise[:, None] ** 2
                + (spread[:, None] * self.rows.rate[both]) ** 2
            )

            def density(variance):
                row = residual / variance + np.log(variance)
                half = row.shape[1] // 2
                return -(row[:, :half] + row[:, half:]) / 2

            good = density(variance) + np.log1p(-fraction)[:, None]
            bad = density(variance + self.width**2) + np.log(fraction)[:, None]
            return np.logaddexp(good, bad).sum(1)

        return sum(map_blocks(block, n, _BLOCK, self.threads))

    def start(self, rng: np.random.Generator, walkers: int) -> FloatArray:
        """Coordinates of walkers: those of the model without outliers, and small fractions."""
        theta = self.base.start(rng, walkers)
        named = self.base.to_samples(theta, rng)
        top = min(self.fraction.high, self.fraction.low + 0.1)
        fraction = rng.uniform(self.fraction.low, top, walkers)
        linear = [named[name] for name in ("a_x", "a_y", "a_z")]
        if self.spin == "free":
            sums = self.rows.sums()
            error = 1 / np.sqrt(np.diag(sums.matrix)[OMEGA])
            linear += list(error[:, None] * rng.standard_normal((3, walkers)))
        return np.column_stack([theta, fraction, *linear])

    def to_samples(self, theta: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """What a user asks for, by name."""
        k = len(self.base.names)
        samples = self.base.to_samples(theta[:, :k], rng)
        return samples | dict(zip(self.names[k:], theta[:, k:].T))
