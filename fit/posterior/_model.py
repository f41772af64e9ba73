"""Our velocity, H0, and perhaps the dispersion and an excess noise: one posterior, all its coordinates.

Coordinates follow the ridge: u = v H0/H_ref (3), H0, and what else is free. Those of a user are
v = u H_ref/H0, so that densities carry |∂v/∂u| = (H_ref/H0)³. Where the prior knows v better than
the data know u, the ridge runs along H0 at constant v, and v is the coordinate.

A dispersion σ_pec that is fixed enters the weights alone, for H_ref: H0 comes from the dipole.
One with a prior lets the scatter of the galaxies measure σ_pec H0, and H0 as well as that prior allows.
If it were fixed there, a poorly known number would determine H0 to a few per cent.

The same posterior where a fraction of the sources is not to be trusted.

Each source's motion comes from its own error ellipse with probability 1 − f, or, with
probability f, from one widened by B in each axis. Nothing can be summed beforehand: a sample
costs one look at every source, and ã (and ω, if free) are sampled with the rest.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fit.posterior._likelihood import CompressedLikelihood, compress_likelihood
from fit.posterior._priors import ModelPriors
from fit.sampling import Prior
from fit.secular_parallax import OMEGA, A, ParallaxEquations, ParallaxParts
from vsh.tools.errors import ParameterError
from vsh.tools.parallel import map_blocks
from vsh.tools.types import FloatArray
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class ParallaxModel:
    """The posterior of (u, H0, …) given the compressed data."""

    likelihood: CompressedLikelihood
    priors: ModelPriors
    along: str = "u"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return (*(f"{self.along}_{axis}" for axis in "xyz"), *self.priors.free)

    def velocities(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u and v, (n, 3) each, of coordinates (n, d)."""
        ratio = theta[:, 3:4] / self.likelihood.hubble  # H0 is the first of the free numbers
        return (theta[:, :3], theta[:, :3] / ratio) if self.along == "u" else (theta[:, :3] * ratio, theta[:, :3])

    def log_jacobian(self, ratio: FloatArray) -> FloatArray | float:
        """log |∂v/∂(coordinates)|, or |∂u/∂(coordinates)| for a prior that is flat in u."""
        if self.priors.velocity.in_product:
            return 0.0 if self.along == "u" else 3 * np.log(ratio)
        return -3 * np.log(ratio) if self.along == "u" else 0.0

    def log_probability(self, theta: FloatArray) -> FloatArray:
        """Log posterior density of coordinates (n, d), up to a constant."""
        total = self.priors.log(theta[:, 3:])
        good = np.isfinite(total)
        spreads, ratio = self.spreads(theta[good, 3:])
        u, v = self.velocities(theta[good])
        c, peak, matrix = self.likelihood(spreads)
        away = u - peak
        total[good] += c - np.einsum("ni,nij,nj->n", away, matrix, away) / 2
        total[good] += self.priors.velocity.log(v) + self.log_jacobian(ratio)
        return np.where(np.isnan(total), -np.inf, total)

    def spreads(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        """s, x and q of the likelihood, (3, n), and H0/H_ref, from the free numbers (n, k)."""
        columns = dict(zip(self.priors.free, numbers.T, strict=True))
        ratio = columns["H0"] / self.likelihood.hubble
        spread = (
            columns["peculiar_dispersion"] * ratio
            if "peculiar_dispersion" in columns
            else np.full(ratio.shape, self.priors.peculiar_dispersion)
        )
        excess_noise = np.broadcast_to(columns.get("excess_noise", self.priors.excess_noise), ratio.shape)
        # Without a prior the flow's amplitude stands for H_ref and weighs only; with one it tells H0.
        flow = columns["flow_amplitude"] * ratio if "flow_amplitude" in columns else np.ones(ratio.shape)
        inside = [
            np.clip(value, axis.low, axis.high)
            for value, axis in zip((spread, excess_noise, flow), self.likelihood.axes, strict=True)
        ]
        return np.stack(inside), ratio

    def conditional(self, numbers: FloatArray, with_priors: bool = True) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log of the posterior at free numbers (n, k), a Gaussian v marginalised exactly; its mean and covariance."""
        spreads, ratio = self.spreads(numbers)
        c, peak, matrix = self.likelihood(spreads)
        prior = self.priors.velocity
        data = matrix * ratio[:, None, None] ** 2
        pull = np.einsum("nij,nj->ni", matrix, peak) * ratio[:, None] + prior.precision @ prior.mean
        precision = data + prior.precision
        covariance = np.linalg.inv(precision)
        mean = np.einsum("nij,nj->ni", covariance, pull)
        misfit = np.einsum("ni,nij,nj->n", peak, matrix, peak) + prior.mean @ prior.precision @ prior.mean
        log = c - (misfit - np.einsum("ni,ni->n", pull, mean)) / 2 - np.linalg.slogdet(precision)[1] / 2
        if prior.proper:
            log += np.linalg.slogdet(prior.precision)[1] / 2
        if prior.in_product:
            log += 3 * np.log(ratio)
        return (self.priors.log(numbers) + log if with_priors else log), mean, covariance

    def start(self, rng: np.random.Generator, walkers: int) -> FloatArray:
        """Coordinates of walkers, (walkers, d): candidates drawn, weighed, and drawn again around the best."""
        limits = np.array([self.priors.limits(name) for name in self.priors.free])
        low, high = limits.T
        many = max(4000, 20 * walkers)
        numbers, log_drawn = rng.uniform(low, high, (many, len(low))), 0.0
        for _ in range(4):
            first, log_first = self.draw_velocity(rng, numbers)
            theta = np.column_stack([first, numbers])
            log_weight = self.log_probability(theta) - log_drawn - log_first
            if not np.isfinite(log_weight).any():
                raise ParameterError("the posterior is zero wherever it was tried: priors and data exclude each other")
            weight = np.exp(log_weight - log_weight.max())
            weight /= weight.sum()
            mean = weight @ numbers
            width = np.sqrt(weight @ (numbers - mean) ** 2) * 1.5 + 1e-6 * (high - low)
            chosen = np.argsort(-(log_weight + rng.gumbel(size=len(numbers))))[:walkers]
            best = theta[chosen]
            # One in ten anywhere, so that no weight runs away; what falls outside has no density.
            anywhere = rng.uniform(size=(many, 1)) < 0.1
            numbers = np.where(
                anywhere, rng.uniform(low, high, (many, len(low))), rng.normal(mean, width, (many, len(low)))
            )
            numbers = numbers[((numbers >= low) & (numbers <= high)).all(1)]
            near = np.log(0.9) - np.sum(((numbers - mean) / width) ** 2 / 2 + np.log(width * np.sqrt(2 * np.pi)), 1)
            log_drawn = np.logaddexp(near, np.log(0.1) - np.log(high - low).sum())
        return best

    def draw_velocity(
        self, rng: np.random.Generator | np.random.RandomState, numbers: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The first three coordinates given the rest, (n, 3), and the log-density they were drawn with."""
        mean, root, logdet = self._first_given(numbers)
        unit = rng.standard_normal(mean.shape)
        return mean + np.einsum("nij,nj->ni", root, unit), -np.sum(unit**2, 1) / 2 - logdet

    def log_density_of_velocity(self, theta: FloatArray) -> FloatArray:
        """The log-density with which `draw_velocity` gives the first three of coordinates (n, d)."""
        mean, root, logdet = self._first_given(theta[:, 3:])
        unit = np.linalg.solve(root, (theta[:, :3] - mean)[..., None])[..., 0]
        return -np.sum(unit**2, 1) / 2 - logdet

    def _first_given(self, numbers):
        """Mean, root of the covariance and its log-determinant of the first three coordinates, given the rest."""
        spreads, ratio = self.spreads(numbers)
        if self.priors.velocity.gaussian:
            _, mean, covariance = self.conditional(numbers)
        else:
            _, mean, matrix = self.likelihood(spreads)
            mean, covariance = mean / ratio[:, None], np.linalg.inv(matrix) / ratio[:, None, None] ** 2
        if self.along == "u":
            mean, covariance = mean * ratio[:, None], covariance * ratio[:, None, None] ** 2
        root = np.linalg.cholesky(covariance)
        return mean, root, np.log(np.einsum("nii->ni", root)).sum(1)

    def to_samples(self, theta: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """What a user asks for, by name: v, H0, the others, and ã, drawn given them."""
        numbers = theta[:, 3:]
        spreads, _ = self.spreads(numbers)
        u, v = self.velocities(theta)
        samples = dict(zip(("v_x", "v_y", "v_z"), v.T)) | {"speed": np.linalg.norm(v, axis=1)}
        samples |= dict(zip(self.priors.free, numbers.T))
        mean, covariance = self.likelihood.acceleration(spreads, u)
        a = mean + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(mean.shape))
        return samples | dict(zip(("a_x", "a_y", "a_z"), a.T))


def parallax_model(
    rows: ParallaxEquations | ParallaxParts,
    given: ModelPriors,
    spin: Literal["free"] | Vector | None = None,
    threads: int | None = None,
) -> ParallaxModel:
    """The posterior of a catalogue's equations under priors."""
    spread, flow = given.limits("peculiar_dispersion"), (1.0, 1.0)
    slow, fast = (each / rows.hubble for each in given.limits("H0"))
    if "peculiar_dispersion" in given.free:
        spread = spread[0] * slow, spread[1] * fast
    if "flow_amplitude" in given.free:
        if rows.modes is None:
            raise ParameterError('an amplitude of the flow needs a flow: flows="linear"')
        low, high = given.limits("flow_amplitude")
        flow = max(low, 1e-3) * slow, high * fast
    table = compress_likelihood(
        rows, spread, given.limits("excess_noise"), spin, flow=flow, acceleration=given.acceleration, threads=threads
    )
    return ParallaxModel(table, given, "v" if _is_known(given.velocity, table) else "u")


def _is_known(velocity, table):
    """Whether the prior on the velocity says more than the data, where they say most."""
    if not (velocity.gaussian and velocity.proper):
        return False
    _, _, matrix = table(np.array([[axis.low] for axis in table.axes]))
    return np.trace(np.linalg.inv(velocity.precision)) < np.trace(np.linalg.inv(matrix[0]))


_BLOCK = 2**12


@dataclass(frozen=True, eq=False)
class MixtureModel:
    """The posterior of (u, H0, …, outlier_fraction, ã[, ω])."""

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
        """Names of the coordinates."""
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
