"""The same posterior without chance: on a grid, for cross-check and for figures."""

from dataclasses import dataclass

import numpy as np

from fit.posterior._model import drift_model
from fit.posterior._priors import priors
from fit.secular_parallax import drift_rows
from vsh.checks import arguments
from vsh.checks.frozen import Frozen
from vsh.errors import ParameterError
from vsh.field import Field
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class GridPosterior(Frozen):
    """Probabilities on a grid of H0 and perhaps one more, with the velocity integrated exactly.

    Attributes
    ----------
    names : tuple of str
        H0, and sigma_pec or sigma_extra where free.
    axes : tuple of arrays
        Values of each.
    probability : array
        Of each point of the grid; sums to 1.
    velocity : Vector
        Mean and covariance of v. [km/s, toward the apex]
    """

    names: tuple
    axes: tuple
    probability: np.ndarray
    velocity: Vector

    def marginal(self, name):
        """Values and probabilities of one quantity: two arrays."""
        index = self.names.index(name)
        others = tuple(i for i in range(len(self.names)) if i != index)
        return self.axes[index], self.probability.sum(others)

    def mean(self, name):
        """Posterior mean."""
        x, p = self.marginal(name)
        return float(x @ p)

    def sigma(self, name):
        """Posterior standard deviation."""
        x, p = self.marginal(name)
        return float(np.sqrt((x - x @ p) ** 2 @ p))


@arguments.accepts(field=arguments.a(Field), points=arguments.whole)
def grid(
    field,
    velocity_prior="planck",
    hubble_prior="flat",
    cosmology=None,
    peculiar=750.0,
    extra=0.0,
    spin=None,
    points=400,
    threads=None,
):
    """Evaluate the posterior on a grid of its non-linear parameters, at most two.

    Parameters
    ----------
    field, velocity_prior, hubble_prior, cosmology, peculiar, extra, spin, threads
        As for `fit.posterior.sample`; the velocity's prior must be Gaussian or flat.
    points : int — along each axis

    Returns
    -------
    GridPosterior

    Raises
    ------
    ParameterError
        If more than two numbers are free, or the velocity's prior is a function.
    """
    given = priors(velocity_prior, hubble_prior, peculiar, extra, field.frame)
    free = tuple(given.free)
    if len(free) > 2:
        raise ParameterError(f"a grid of {', '.join(free)} is too large: fix all but two, or sample")
    if not given.velocity.gaussian:
        raise ParameterError("on a grid the prior on the velocity must be Gaussian or flat")
    model = drift_model(drift_rows(field, cosmology), given, spin, threads)
    limits = [given.limits(name) for name in free]
    for _ in range(3):  # the last two on what the one before left over
        axes = [_midpoints(*pair, points) for pair in limits]
        points_of = np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")], axis=1)
        log, mean, covariance = model.conditional(points_of)
        p = np.exp(log - log.max())
        p = (p / p.sum()).reshape([len(axis) for axis in axes])
        limits = [_support(axis, p, i) for i, axis in enumerate(axes)]
    weight = p.ravel()
    centre = weight @ mean
    away = mean - centre
    spread = np.einsum("n,nij->ij", weight, covariance) + np.einsum("n,ni,nj->ij", weight, away, away)
    return GridPosterior(free, tuple(axes), p, Vector(centre, spread, field.frame, "km/s"))


def _midpoints(low, high, count):
    edges = np.linspace(low, high, count + 1)
    return (edges[1:] + edges[:-1]) / 2


def _support(axis, p, index):
    """Limits beyond which there is less than 1e-9 of the probability."""
    one = p.sum(tuple(i for i in range(p.ndim) if i != index))
    inside = np.flatnonzero(one > 1e-9 * one.max())
    step = axis[1] - axis[0]
    return axis[inside[0]] - step / 2, axis[inside[-1]] + step / 2
