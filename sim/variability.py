"""Variable photocentres: a Gaussian Markov chain.

Bachchan, Hobbs & Lindegren (2016), eqs. 8 and 9: x_i = e^{−Δt/τ} x_{i−1} + g_i, with g_i of
standard deviation σ √(1 − e^{−2Δt/τ}).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vsh.tools.arguments import generator, not_negative, positive
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray, IntArray, Rng


@dataclass(frozen=True)
class Variability(InNotebook):
    """Variability of the photocentre: independent in α* and δ, with the same parameters.

    Attributes
    ----------
    sigma : float
        Standard deviation of the position at any time [µas]
    tau : float
        Time in which its correlation falls to 1/e [yr]

    Examples
    --------
    >>> Variability(sigma=100.0, tau=2.0)
    Variability(sigma=100.0, tau=2.0)
    """

    sigma: float
    tau: float

    def __post_init__(self) -> None:
        not_negative("sigma", self.sigma)
        positive("tau", self.tau)

    def covariance(self, times: FloatArray) -> FloatArray:
        """Covariance of one coordinate at `times` [yr], (k, k). [µas²]"""
        return self.sigma**2 * np.exp(-np.abs(np.subtract.outer(times, times)) / self.tau)


def markov_chain(times: FloatArray, sigma: float, tau: float, rng: Rng, source: IntArray | None = None) -> FloatArray:
    """Draw the chain at irregular times."""
    Variability(sigma, tau)
    times = np.asarray(times, float)
    source = np.zeros(times.shape, int) if source is None else np.asarray(source)
    draws = generator(rng).standard_normal(len(times))
    is_first = np.r_[True, source[1:] != source[:-1]] if len(times) else np.zeros(0, bool)
    intervals = np.diff(times, prepend=0.0)
    if (intervals[~is_first] < 0).any():
        raise ParameterError("the times of a chain must rise")
    correlation = np.where(is_first, 0.0, np.exp(-np.where(is_first, 0.0, intervals) / tau))
    chain = sigma * np.sqrt(1 - correlation**2) * draws
    for rows in _group_observations_by_rank(is_first):
        chain[rows] += correlation[rows] * chain[rows - 1]
    return chain


def chain_products(weights: FloatArray, source: IntArray, times: FloatArray, tau: float) -> FloatArray:
    """Covariances of weighted sums of chains of unit variance: Σ over sources of aᵀ C a', C_ij = e^{−|t_i − t_j|/τ}."""
    is_first = np.r_[True, source[1:] != source[:-1]] if len(times) else np.zeros(0, bool)
    correlation = np.where(is_first, 0.0, np.exp(-np.where(is_first, 0.0, np.diff(times, prepend=0.0)) / tau))
    # What all earlier observations of a source amount to at each: one step of the chain after the other.
    earlier_sums = np.zeros_like(weights)
    for rows in _group_observations_by_rank(is_first):
        earlier_sums[..., rows] = correlation[rows] * (earlier_sums[..., rows - 1] + weights[..., rows - 1])
    cross_products = np.einsum("aik,bik->ab", weights, earlier_sums)
    return np.einsum("aik,bik->ab", weights, weights) + cross_products + cross_products.T


def _group_observations_by_rank(is_first):
    """Indices of all second observations of a source, then of all third ones, …: chains step together."""
    first_rows = np.flatnonzero(is_first)
    ranks = np.arange(len(is_first)) - np.repeat(first_rows, np.diff(np.r_[first_rows, len(is_first)]))
    order = np.argsort(ranks, kind="stable")
    rank_ends = np.cumsum(np.bincount(ranks)) if len(is_first) else []
    for begin, end in pairwise(rank_ends):
        yield order[begin:end]
