"""Our velocity, H0, and perhaps the dispersion and an extra error: one posterior, all its coordinates.

Coordinates follow the ridge: u = v H0/H_ref (3), H0, and what else is free. Those of a user are
v = u H_ref/H0, so that densities carry |∂v/∂u| = (H_ref/H0)³. Where the prior knows v better than
the data know u, the ridge runs along H0 at constant v, and v is the coordinate.

A dispersion σ_pec that is fixed enters the weights alone, for H_ref: H0 comes from the dipole.
One with a prior makes the scatter of the galaxies a ruler of σ_pec H0, as good as the prior is.
Fixing it there would let a number that nobody knows measure H0 to a few per cent.
"""

from dataclasses import dataclass

import numpy as np

from fit.priors import PLANCK_HUBBLE, Flat, Normal, as_prior, integrable_over_cube, velocity_prior
from fit.ridge import Ridge, ridge
from vsh.errors import ParameterError

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
class DriftModel:
    """The posterior of (u, H0, …) given the compressed data.

    Attributes
    ----------
    ridge : Ridge
    priors : Priors
    along : {"u", "v"}
        The first three coordinates.
    """

    ridge: Ridge
    priors: Priors
    along: str = "u"

    @property
    def names(self):
        """Of the coordinates."""
        return (*(f"{self.along}_{axis}" for axis in "xyz"), *self.priors.free)

    def velocities(self, theta):
        """u and v, (n, 3) each, of coordinates (n, d)."""
        ratio = theta[:, 3:4] / self.ridge.hubble  # H0 is the first of the free numbers
        return (theta[:, :3], theta[:, :3] / ratio) if self.along == "u" else (theta[:, :3] * ratio, theta[:, :3])

    def log_jacobian(self, ratio):
        """log |∂v/∂(coordinates)|, or |∂u/∂(coordinates)| for a prior that is flat in u."""
        if self.priors.velocity.in_product:
            return 0.0 if self.along == "u" else 3 * np.log(ratio)
        return -3 * np.log(ratio) if self.along == "u" else 0.0

    def log_probability(self, theta):
        """Log posterior density of coordinates (n, d), up to a constant."""
        total = self.priors.log(theta[:, 3:])
        good = np.isfinite(total)
        spread, extra, ratio = self.spreads(theta[good, 3:])
        u, v = self.velocities(theta[good])
        c, peak, matrix = self.ridge(spread, extra)
        away = u - peak
        total[good] += c - np.einsum("ni,nij,nj->n", away, matrix, away) / 2
        total[good] += self.priors.velocity.log(v) + self.log_jacobian(ratio)
        return np.where(np.isnan(total), -np.inf, total)

    def spreads(self, numbers):
        """s and x of the likelihood, and H0/H_ref, from the free numbers (n, k)."""
        columns = dict(zip(self.priors.free, numbers.T, strict=True))
        ratio = columns["H0"] / self.ridge.hubble
        spread = columns["sigma_pec"] * ratio if "sigma_pec" in columns else np.full(ratio.shape, self.priors.peculiar)
        extra = np.broadcast_to(columns.get("sigma_extra", self.priors.extra), ratio.shape)
        inside = [np.clip(value, axis.low, axis.high) for value, axis in
                  ((spread, self.ridge.spread), (extra, self.ridge.extra))]  # fmt: skip
        return (*inside, ratio)

    def conditional(self, numbers):
        """Given the free numbers (n, k): log of the posterior with v marginalised, v's mean and covariance.

        For Gaussian (and flat) priors on the velocity, exactly.
        """
        spread, extra, ratio = self.spreads(numbers)
        c, peak, matrix = self.ridge(spread, extra)
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
        return self.priors.log(numbers) + log, mean, covariance

    def start(self, rng, walkers):
        """Coordinates of walkers, spread over the posterior, (walkers, d).

        Candidates are drawn, weighed by their density, and the draw is repeated around the best.
        """
        limits = np.array([self.priors.limits(name) for name in self.priors.free])
        low, high = limits.T
        many = max(4000, 20 * walkers)
        numbers, log_drawn = rng.uniform(low, high, (many, len(low))), 0.0
        for _ in range(4):
            first, log_first = self._draw(rng, numbers)
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

    def _draw(self, rng, numbers):
        """The first three coordinates given the rest, and the log-density they were drawn with."""
        spread, extra, ratio = self.spreads(numbers)
        if self.priors.velocity.gaussian:
            _, mean, covariance = self.conditional(numbers)
        else:
            _, mean, matrix = self.ridge(spread, extra)
            mean, covariance = mean / ratio[:, None], np.linalg.inv(matrix) / ratio[:, None, None] ** 2
        if self.along == "u":
            mean, covariance = mean * ratio[:, None], covariance * ratio[:, None, None] ** 2
        unit = rng.standard_normal(mean.shape)
        root = np.linalg.cholesky(covariance)
        logdet = np.log(np.einsum("nii->ni", root)).sum(1)
        return mean + np.einsum("nij,nj->ni", root, unit), -np.sum(unit**2, 1) / 2 - logdet

    def to_samples(self, theta, rng):
        """What a user asks for, by name: v, H0, the others, and ã, drawn given them."""
        numbers = theta[:, 3:]
        spread, extra, _ = self.spreads(numbers)
        u, v = self.velocities(theta)
        samples = dict(zip(("v_x", "v_y", "v_z"), v.T)) | {"speed": np.linalg.norm(v, axis=1)}
        samples |= dict(zip(self.priors.free, numbers.T))
        mean, covariance = self.ridge.acceleration(spread, extra, u)
        a = mean + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(mean.shape))
        return samples | dict(zip(("a_x", "a_y", "a_z"), a.T))


def drift_model(rows, given, spin=None, threads=None):
    """The posterior of a catalogue's equations under priors."""
    spread = given.limits("sigma_pec")
    if "sigma_pec" in given.free:
        spread = tuple(s * h / rows.hubble for s, h in zip(spread, given.limits("H0"), strict=True))
    table = ridge(rows, spread, given.limits("sigma_extra"), spin, threads=threads)
    return DriftModel(table, given, "v" if _is_known(given.velocity, table) else "u")


def _is_known(velocity, table):
    """Whether the prior on the velocity says more than the data, where they say most."""
    if not (velocity.gaussian and velocity.proper):
        return False
    _, _, matrix = table(np.array([table.spread.low]), np.array([table.extra.low]))
    return np.trace(np.linalg.inv(velocity.precision)) < np.trace(np.linalg.inv(matrix[0]))
