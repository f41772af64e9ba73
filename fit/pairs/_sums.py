"""Sums over pairs: no noise in them, and no mask.

What all pairs of sources add up to, from one pass over the sources: harmonics of the weighted motions, and self-pairs.

The sum over all pairs of a function of their angle is a sum over degrees of the power of the weighted motions, by the
addition theorem. A source paired with itself adds a constant to every degree that is known exactly: taken away, noise
that sources do not share is in no power, whatever its size.

Errors of sums over pairs, from how the sums of blocks of the sky scatter.

What is estimated is a sum over pairs of blocks, R_kk + Σ R_km. Leaving out block after block, as the jackknife does,
counts what a pair of blocks scatters by twice, once with each of them (Efron & Stein 1981, Ann. Stat. 9, 586): without
a signal, errors come out √2 too large. The scatter of the pairs themselves, free of what their blocks have in common,
is therefore taken off once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
from itertools import pairwise
from operator import add

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from vsh.field import Field
from vsh.io.parts import Parts, find_single_frame
from vsh.models.covariance import d_minus, d_plus
from vsh.modes import Modes, ScalarModes
from vsh.sky.pixels import pixels_of
from vsh.tools.arguments import float_array
from vsh.tools.errors import FieldError, ParameterError
from vsh.tools.notes import drop_empty_notes, merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, FloatArray

#: The share of pairs of different sources in all of the weight, of which no digit is lost that matters.
_LEAST_PAIRED_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums over sources; they add."""

    lmax: int
    motions: FloatArray
    weights: FloatArray
    ones: FloatArray
    self_pairs: FloatArray

    def __add__(self, other: PairSums) -> PairSums:
        sums = (getattr(self, name) + getattr(other, name) for name in ("motions", "weights", "ones", "self_pairs"))
        return PairSums(self.lmax, *sums)

    @property
    def spectra(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """All pairs of different sources: T + S and T − S of the motions, (lmax,); weights and numbers, (lmax + 1,)."""
        modes, scalar = Modes(self.lmax), ScalarModes(self.lmax)
        toroidal, spheroidal = np.split(self.motions**2 / modes.norm2, 2)
        degrees = modes.degrees[: len(toroidal)]
        power_t, power_s = (np.bincount(degrees, x, self.lmax + 1)[1:].astype(float) for x in (toroidal, spheroidal))
        l = np.arange(self.lmax + 1)
        self_sum = np.multiply.outer(self.self_pairs, (2 * l + 1) / (4 * np.pi))
        weights, numbers = (
            np.bincount(scalar.degrees, values**2 / scalar.norm2, self.lmax + 1) for values in (self.weights, self.ones)
        )
        if weights[0] - self_sum[1][0] < _LEAST_PAIRED_SHARE * weights[0]:  # what is left of it would be rounding
            raise FieldError("one source has all the weight, and no pair has any: look at its error, or leave it out")
        return power_t + power_s - self_sum[0, 1:], power_t - power_s, weights - self_sum[1], numbers - self_sum[2]


def sum_pairs(
    field: Field | Parts, lmax: int, nside: int, weights: ArrayLike | None, threads: int | None
) -> tuple[PairSums, list[PairSums], str, tuple[str, ...]]:
    """Sum over all sources, and over each HEALPix block that holds some; the frame, and notes."""
    if isinstance(field, Parts):
        if weights is not None:
            raise ParameterError("weights= are those of a Field in memory; those of parts follow from their errors")
        sums = field.sum(partial(_sum_pairs_of_part, lmax=lmax, nside=nside), roles=(), words="pairs")
    else:
        if weights is not None:
            weights = float_array("weights", weights, (len(field),))
            if (weights < 0).any() or not weights.any():
                raise ParameterError(f"weights are zero or more, not all zero: {np.sum(weights < 0)} are below zero")
        if len(field) < 2:
            raise FieldError("pairs need two sources at least")
        sums = _sum_pairs_of_part(field, lmax, nside, weights, threads)
    frame = find_single_frame(sums["frames"])
    blocks = [sums["blocks"][pixel] for pixel in sorted(sums["blocks"])]
    total = reduce(add, blocks)
    if total.self_pairs[2] < 2:
        raise FieldError("pairs need two sources at least")
    return total, blocks, frame, drop_empty_notes(merge_notes(*sums["notes"]))


def _sum_pairs_of_part(field, lmax, nside, weights=None, threads=1):
    blocks = _sum_pairs_by_block(field, lmax, nside, weights, threads)
    return {"blocks": blocks, "frames": [field.frame], "notes": [tuple(field.notes)]}


def _sum_pairs_by_block(field, lmax, nside, weights, threads):
    """Sum over the sources of each pixel, by pixel."""
    pixel_numbers = pixels_of(field.lon, field.lat, nside)
    order = np.argsort(pixel_numbers, kind="stable")
    starts = np.flatnonzero(np.diff(pixel_numbers[order], prepend=-1))
    pixel_rows = np.split(order, starts[1:])
    weights = 2 / np.sum(field.sigma**2, axis=0) if weights is None else weights
    block_sums = map_blocks(
        lambda chunk: _sum_in_block(field, weights, pixel_rows[chunk.start], lmax), len(pixel_rows), 1, threads, "pairs"
    )
    return dict(zip(pixel_numbers[order][starts].tolist(), block_sums, strict=True))


def _sum_in_block(field, weights, rows, lmax):
    from vsh.transform import adjoint

    lon, lat, w, motion = field.lon[rows], field.lat[rows], weights[rows], field.motion[:, rows]
    scalar = ScalarModes(lmax)
    return PairSums(
        lmax,
        adjoint(Modes(lmax), lon, lat, w * motion, threads=1),
        adjoint(scalar, lon, lat, w[None], threads=1),
        adjoint(scalar, lon, lat, np.ones((1, len(rows))), threads=1),
        np.array([np.sum((w * motion) ** 2), np.sum(w**2), len(rows)]),
    )


def find_covariance(blocks: Sequence[PairSums], plus: FloatArray, minus: FloatArray, weight: FloatArray) -> FloatArray:
    """Find the covariance of k linear functions of the spectra of pairs, (k, k); nan of less than four blocks."""
    n = len(blocks)
    if n < 4:
        return np.full((len(plus),) * 2, np.nan)
    cross_terms = _compute_cross_terms(blocks, plus, minus, weight)
    self_terms = np.einsum("bkk->bk", cross_terms)
    pair_terms = 2 * cross_terms
    pair_terms[:, range(n), range(n)] = 0.0
    contributions = self_terms + pair_terms.sum(2)
    deviation = contributions - contributions.mean(1, keepdims=True)
    jackknife = n / (n - 1) * deviation @ deviation.T
    # What each pair of blocks has that neither of the two has with all others.
    block_effects = pair_terms.sum(2) / (n - 2)
    mean_effect = block_effects.sum(1) * (n - 2) / (n - 1) / n
    residuals = (
        pair_terms - block_effects[:, :, None] - block_effects[:, None, :] + (mean_effect * n / (n - 2))[:, None, None]
    )
    residuals[:, range(n), range(n)] = 0.0
    double_counted = np.sum(residuals**2, axis=(1, 2)) / 2 * (n - 1) / (n - 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        shrink = np.sqrt(np.clip(1 - double_counted / np.diag(jackknife), 0.5, 1.0))
    return jackknife * np.outer(shrink, shrink)


def _compute_cross_terms(blocks, plus, minus, weight):
    """R_km: the functions for pairs of one source in block k and another in block m, (k, blocks, blocks)."""
    lmax = blocks[0].lmax
    modes, scalar = Modes(lmax), ScalarModes(lmax)
    motions = np.array([block.motions for block in blocks]) / np.sqrt(modes.norm2)
    weights = np.array([block.weights for block in blocks]) / np.sqrt(scalar.norm2)
    self_sums = np.array([block.self_pairs for block in blocks])
    terms = np.zeros((len(plus), len(blocks), len(blocks)))
    for l in range(lmax + 1):
        block_weights = weights[:, scalar.slice_of("F", l)]
        weight_products = block_weights @ block_weights.T - np.diag(self_sums[:, 1] * (2 * l + 1) / (4 * np.pi))
        terms += weight[:, l, None, None] * weight_products
        if l == 0:
            continue
        t, s = (motions[:, modes.slice_of(kind, l)] for kind in modes.kinds)
        tt, ss, self_sum = t @ t.T, s @ s.T, np.diag(self_sums[:, 0] * (2 * l + 1) / (4 * np.pi))
        terms += plus[:, l - 1, None, None] * (tt + ss - self_sum) + minus[:, l - 1, None, None] * (tt - ss)
    return terms


@dataclass(frozen=True, eq=False)
class Windows:
    """Smooth bins: hats sin² that rise from one edge to the next and fall to the one after."""

    theta: FloatArray
    values: FloatArray
    plus: FloatArray
    minus: FloatArray
    scalar: FloatArray

    @property
    def by_degree(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrices that sum each bin from spectra of T + S, T − S and of weights: (k, lmax), (k, lmax), (k, lmax +
        1)."""
        plus, minus, scalar = (2 * np.pi * self.values @ basis.T for basis in (self.plus, self.minus, self.scalar))
        return plus, minus, scalar


def make_windows(edges: FloatArray, lmax: int) -> Windows:
    """Make the bins between edges."""
    return _compute_windows(tuple(map(float, edges)), lmax)


@lru_cache(maxsize=4)
def _compute_windows(edges, lmax):
    theta, weights, ramps = [], [], []
    for lower, upper in pairwise(edges):
        nodes_of_panel, panel_weights = leggauss(24 + int(0.7 * lmax * (upper - lower)))
        theta.append(lower + (upper - lower) * (nodes_of_panel + 1) / 2)
        weights.append(panel_weights * (upper - lower) / 2 * np.sin(theta[-1]))
        ramps.append(np.sin(np.pi / 4 * (nodes_of_panel + 1)) ** 2)
    nodes = np.concatenate(theta)
    starts = np.concatenate([[0], np.cumsum([len(angles) for angles in theta])])
    values = np.zeros((len(edges) - 2, len(nodes)))
    for k, window in enumerate(values):
        window[starts[k] : starts[k + 1]] = ramps[k] * weights[k]
        window[starts[k + 1] : starts[k + 2]] = (1 - ramps[k + 1]) * weights[k + 1]
    return Windows(nodes, values, d_plus(lmax, nodes), d_minus(lmax, nodes), legvander(np.cos(nodes), lmax).T)


def check_bin_edges(edges: ArrayLike) -> FloatArray:
    """Check edges of bins: they ascend from 0 to π at most."""
    array = float_array("edges", edges)
    if array.ndim != 1 or array.size < 3:
        raise ParameterError(
            "edges are three angles or more, in rad: a bin rises from one to the next and falls to the third, not "
            f"{array.size}"
        )
    if not (np.diff(array) > 0).all() or array[0] < 0 or array[-1] > np.pi + 1e-9:
        raise ParameterError(
            f"edges ascend from 0 to π at most [rad], not from {array[0]:.4g} to {array[-1]:.4g}: np.radians of degrees"
        )
    return np.minimum(array, np.pi)
