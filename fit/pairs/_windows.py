"""Bins of angle, and how they look at each degree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from vsh.checks.arrays import float_array
from vsh.checks.types import ArrayLike, FloatArray
from vsh.covariance import d_minus, d_plus
from vsh.errors import ParameterError


@dataclass(frozen=True, eq=False)
class Windows:
    """Smooth bins: hats sin² that rise from one edge to the next and fall to the one after.

    Attributes
    ----------
    theta : (m,) array
        Nodes of the integrals over the angle. [rad]
    values : (k, m) array
        Each bin at the nodes, times sin θ and the weight of the node.
    plus, minus, scalar : (lmax, m), (lmax, m), (lmax + 1, m) arrays
        d⁺_l, d⁻_l and P_l at the nodes.
    """

    theta: FloatArray
    values: FloatArray
    plus: FloatArray
    minus: FloatArray
    scalar: FloatArray

    @property
    def by_degree(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What sums each bin from spectra of T + S, T − S and of weights: (k, lmax), (k, lmax), (k, lmax + 1)."""
        plus, minus, scalar = (2 * np.pi * self.values @ each.T for each in (self.plus, self.minus, self.scalar))
        return plus, minus, scalar


def windows(edges: FloatArray, lmax: int) -> Windows:
    """The bins between edges."""
    return _windows(tuple(map(float, edges)), lmax)


@lru_cache(maxsize=4)
def _windows(edges, lmax):
    theta, weight, ramp = [], [], []
    for low, high in pairwise(edges):
        x, w = leggauss(24 + int(0.7 * lmax * (high - low)))
        theta.append(low + (high - low) * (x + 1) / 2)
        weight.append(w * (high - low) / 2 * np.sin(theta[-1]))
        ramp.append(np.sin(np.pi / 4 * (x + 1)) ** 2)
    nodes = np.concatenate(theta)
    starts = np.concatenate([[0], np.cumsum([len(each) for each in theta])])
    values = np.zeros((len(edges) - 2, len(nodes)))
    for k, row in enumerate(values):
        row[starts[k] : starts[k + 1]] = ramp[k] * weight[k]
        row[starts[k + 1] : starts[k + 2]] = (1 - ramp[k + 1]) * weight[k + 1]
    return Windows(nodes, values, d_plus(lmax, nodes), d_minus(lmax, nodes), legvander(np.cos(nodes), lmax).T)


def checked_edges(edges: ArrayLike) -> FloatArray:
    """Edges of bins, ascending from 0 to π at most."""
    found = float_array("edges", edges)
    if found.ndim != 1 or found.size < 3:
        raise ParameterError(
            f"edges are three angles or more, in rad: a bin rises from one to the next and falls to the third, not {found.size}"
        )
    if not (np.diff(found) > 0).all() or found[0] < 0 or found[-1] > np.pi + 1e-9:
        raise ParameterError(
            f"edges ascend from 0 to π at most [rad], not from {found[0]:.4g} to {found[-1]:.4g}: np.radians of degrees"
        )
    return np.minimum(found, np.pi)
