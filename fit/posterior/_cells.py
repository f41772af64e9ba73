"""The numbers that are not linear, in small cells: draws of the posterior, and moves by them.

Given H0 and what else is free the velocity is Gaussian, so that a cell of one or two numbers is all there is to draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from fit.posterior._model import ParallaxModel
from fit.posterior._priors import ModelPriors
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray

#: How many numbers cells are made of at most; cells along each for one and for two, to see where it is and in the end.
MOST = 2
_COUNTS = {1: (400, 4000), 2: (100, 200)}


@dataclass(frozen=True, eq=False)
class Cells:
    """The posterior of the free numbers, the velocity integrated, constant within each cell.

    Attributes
    ----------
    model : ParallaxModel
        With a velocity whose prior is Gaussian or flat, and two free numbers at most.
    edges : tuple of arrays
        Edges of the cells along each number.
    probability : array
        Probability of each cell; sums to 1.
    mean, covariance : (n, 3) and (n, 3, 3) arrays
        Moments of the velocity in the middle of each cell, the last number running fastest. [km/s]
    """

    model: ParallaxModel
    edges: tuple[FloatArray, ...]
    probability: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, model: ParallaxModel, count: int | None = None) -> Cells:
        """Those of a model: `count` of equal size along each number, or closer where the density is high."""
        limits = [model.priors.limits(name) for name in model.priors.free]
        few, many = _COUNTS[len(limits)]
        edges = [np.linspace(*pair, (count or few) + 1) for pair in limits]
        for _ in range(2):  # what the one before left over
            coarse = cls._on(model, edges)
            limits = [_support(edge, share) for edge, share in zip(edges, coarse.shares, strict=True)]
            edges = [np.linspace(*pair, (count or few) + 1) for pair in limits]
        cells = cls._on(model, edges)
        if count is not None:
            return cells
        return cls._on(model, [_closer(edge, p, many) for edge, p in zip(edges, cells.shares, strict=True)])

    @classmethod
    def _on(cls, model, edges):
        middles = [(edge[1:] + edge[:-1]) / 2 for edge in edges]
        points = np.stack([each.ravel() for each in np.meshgrid(*middles, indexing="ij")], axis=1)
        log, mean, covariance = model.conditional(points)
        volume = reduce(np.multiply.outer, [np.diff(edge) for edge in edges])
        p = np.exp(log - log.max()).reshape(volume.shape) * volume
        return cls(model, tuple(edges), p / p.sum(), mean, covariance)

    @property
    def shares(self) -> list[FloatArray]:
        """The probabilities along each number, the other summed."""
        axes = range(self.probability.ndim)
        return [self.probability.sum(tuple(i for i in axes if i != axis)) for axis in axes]

    @property
    def axes(self) -> tuple[FloatArray, ...]:
        """The middles of the cells along each number."""
        return tuple((edge[1:] + edge[:-1]) / 2 for edge in self.edges)

    @property
    def hubble(self) -> tuple[float, float]:
        """Mean and standard deviation of H0. [km/s/Mpc]"""
        share, x = self.shares[0], self.axes[0]
        mean = float(share @ x)
        return mean, float(np.sqrt(share @ (x - mean) ** 2))

    def draw(self, rng: np.random.Generator | np.random.RandomState, n: int) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the model, (n, d), and the log-density they were drawn with, up to a constant."""
        share = np.cumsum(self.probability.ravel())
        cell = np.searchsorted(share, rng.uniform(size=n) * share[-1], side="right")
        where = np.unravel_index(np.minimum(cell, share.size - 1), self.probability.shape)
        low = np.stack([edge[i] for edge, i in zip(self.edges, where, strict=True)], axis=1)
        high = np.stack([edge[i + 1] for edge, i in zip(self.edges, where, strict=True)], axis=1)
        numbers = low + (high - low) * rng.uniform(size=low.shape)
        first, log_first = self.model.draw_velocity(rng, numbers)
        return np.column_stack([first, numbers]), self._log(where) + log_first

    def log_density(self, theta: FloatArray) -> FloatArray:
        """The log-density with which `draw` gives coordinates (n, d), up to the same constant."""
        where, inside = [], np.ones(len(theta), bool)
        for edge, x in zip(self.edges, theta[:, 3:].T, strict=True):
            i = np.searchsorted(edge, x, side="right") - 1
            inside &= (i >= 0) & (i < edge.size - 1)
            where.append(np.clip(i, 0, edge.size - 2))
        log = np.where(inside, self._log(tuple(where)), -np.inf)
        return log + self.model.log_density_of_velocity(theta)

    def propose(self, coordinates: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """A move of emcee: to an independent draw, and by how much it is harder to come back."""
        new, log_new = self.draw(rng, len(coordinates))
        return new, self.log_density(coordinates) - log_new

    def independent(self, rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        """n independent draws of the posterior itself, (n, d), and their log-densities.

        Draws are kept with the ratio of the posterior to the density of the cells, over the largest that was seen: what
        varies within a cell is allowed for.
        """
        kept: list[tuple[FloatArray, FloatArray]] = []
        have, most = 0, -np.inf
        while have < n:
            theta, log_drawn = self.draw(rng, n - have + n // 16 + 100)
            log = self.model.log_probability(theta)
            if not kept:
                most = float(np.max(log - log_drawn))
            keep = np.log(rng.uniform(size=len(theta))) < log - log_drawn - most
            kept.append((theta[keep], log[keep]))
            have += int(keep.sum())
        theta, log = (np.concatenate(each)[:n] for each in zip(*kept, strict=True))
        return theta, log

    def _log(self, where):
        """The log-density within some cells."""
        log_size = sum(np.log(np.diff(edge))[i] for edge, i in zip(self.edges, where, strict=True))
        with np.errstate(divide="ignore"):
            return np.log(self.probability[where]) - log_size


def check_few(priors: ModelPriors) -> None:
    """Raise ParameterError where a posterior is not known in cells."""
    free = tuple(priors.free)
    if len(free) > MOST:
        raise ParameterError(f"a grid of {', '.join(free)} is too large: fix all but two, or sample with emcee")
    if not priors.velocity.gaussian:
        raise ParameterError("on a grid the prior on the velocity must be Gaussian or flat: sample with emcee")


def in_cells(model: Any) -> Cells | None:
    """The cells of a model; None where it has none."""
    try:
        check_few(model.priors)
    except ParameterError:
        return None
    return Cells.of(model) if isinstance(model, ParallaxModel) else None


def _support(edge, share):
    """Limits beyond which there is less than 1e-9 of the probability."""
    inside = np.flatnonzero(share > 1e-9 * share.max())
    return edge[inside[0]], edge[inside[-1] + 1]


def _closer(edge, share, number):
    """Edges of cells of which half share the probability evenly, and half the range."""
    even = np.linspace(0, 1, edge.size)
    return np.interp(np.linspace(0, 1, number + 1), (np.concatenate([[0.0], np.cumsum(share)]) + even) / 2, edge)
