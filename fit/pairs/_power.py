"""Power by degree from pairs: no noise in it, and no mask.

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
from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from fit.results.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.io.sections import Section
from vsh.models.covariance import d_minus, d_plus
from vsh.modes import Modes, ScalarModes
from vsh.sky.pixels import pixels_of
from vsh.tools import arguments
from vsh.tools.arguments import explained, float_array
from vsh.tools.errors import DegeneracyError, FieldError, ParameterError
from vsh.tools.notes import format_notes, merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, Axes, FloatArray, Table

#: The share of pairs of different sources in all of the weight, of which no digit is lost that matters.
_PAIRED = 1e-9


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums over sources; they add."""

    lmax: int
    motions: FloatArray
    weights: FloatArray
    ones: FloatArray
    alone: FloatArray

    def __add__(self, other: PairSums) -> PairSums:
        sums = (getattr(self, name) + getattr(other, name) for name in ("motions", "weights", "ones", "alone"))
        return PairSums(self.lmax, *sums)

    @property
    def spectra(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """All pairs of different sources: T + S and T − S of the motions, (lmax,); weights and numbers, (lmax + 1,)."""
        modes, scalar = Modes(self.lmax), ScalarModes(self.lmax)
        toroidal, spheroidal = np.split(self.motions**2 / modes.norm2, 2)
        degrees = modes.degrees[: len(toroidal)]
        power_t, power_s = (
            np.bincount(degrees, values, self.lmax + 1)[1:].astype(float) for values in (toroidal, spheroidal)
        )
        l = np.arange(self.lmax + 1)
        itself = np.multiply.outer(self.alone, (2 * l + 1) / (4 * np.pi))
        weights, numbers = (
            np.bincount(scalar.degrees, values**2 / scalar.norm2, self.lmax + 1) for values in (self.weights, self.ones)
        )
        if weights[0] - itself[1][0] < _PAIRED * weights[0]:  # what is left of it would be rounding
            raise FieldError(
                "one source has all the weight, and no pair of two has any: look at its error, or leave it out"
            )
        return power_t + power_s - itself[0, 1:], power_t - power_s, weights - itself[1], numbers - itself[2]


class Gathered(NamedTuple):
    """Sums of one pass over the sources."""

    total: PairSums
    blocks: list[PairSums]
    frame: str
    notes: tuple[str, ...]


def sums_of(field: Field | Parts, lmax: int, nside: int, weights: ArrayLike | None, threads: int | None) -> Gathered:
    """The sums of all sources, and of each HEALPix block that holds some."""
    if isinstance(field, Parts):
        if weights is not None:
            raise ParameterError(
                "weights= are of the sources of a Field in memory; those of parts follow from their errors"
            )
        sums = field.sum(partial(_of_part, lmax=lmax, nside=nside), roles=(), words="pairs")
    else:
        if weights is not None:
            weights = float_array("weights", weights, (len(field),))
            if (weights < 0).any() or not weights.any():
                raise ParameterError(
                    f"weights are zero or more, and not all zero: {np.sum(weights < 0)} are below zero"
                )
        sums = _of_part(field, lmax, nside, weights, threads)
    blocks = [sums["blocks"][pixel] for pixel in sorted(sums["blocks"])]
    total = blocks[0]
    for block in blocks[1:]:
        total = total + block
    if total.alone[2] < 2:
        raise FieldError("pairs need two sources at least")
    return Gathered(total, blocks, sums["frames"][0], format_notes(merge_notes(*sums["notes"])))


def _of_part(field, lmax, nside, weights=None, threads=1):
    blocks = _blocks(field, lmax, nside, weights, threads)
    return {"blocks": blocks, "frames": [field.frame], "notes": [tuple(field.notes)]}


def _blocks(field, lmax, nside, weights, threads):
    """Sums by pixel."""
    pixel = pixels_of(field.lon, field.lat, nside)
    order = np.argsort(pixel, kind="stable")
    starts = np.flatnonzero(np.diff(pixel[order], prepend=-1))
    pixel_rows = np.split(order, starts[1:])
    weights = 2 / np.sum(field.sigma**2, axis=0) if weights is None else weights
    work = map_blocks(
        lambda chunk: _sums(field, weights, pixel_rows[chunk.start], lmax), len(pixel_rows), 1, threads, "pairs"
    )
    return dict(zip(pixel[order][starts].tolist(), work, strict=True))


def _sums(field, weights, rows, lmax):
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


def covariance_of(blocks: Sequence[PairSums], plus: FloatArray, minus: FloatArray, weight: FloatArray) -> FloatArray:
    """The covariance of k linear functions of the spectra of pairs, (k, k); nan of less than four blocks."""
    count = len(blocks)
    if count < 4:
        return np.full((len(plus),) * 2, np.nan)
    cross_terms = _cross_terms(blocks, plus, minus, weight)
    itself = np.einsum("bkk->bk", cross_terms)
    pairs = 2 * cross_terms
    pairs[:, range(count), range(count)] = 0.0
    leaving = itself + pairs.sum(2)
    deviation = leaving - leaving.mean(1, keepdims=True)
    jackknife = count / (count - 1) * deviation @ deviation.T
    # What each pair of blocks has that neither of the two has with all others.
    block_effects = pairs.sum(2) / (count - 2)
    mean = block_effects.sum(1) * (count - 2) / (count - 1) / count
    residuals = (
        pairs - block_effects[:, :, None] - block_effects[:, None, :] + (mean * count / (count - 2))[:, None, None]
    )
    residuals[:, range(count), range(count)] = 0.0
    twice = np.sum(residuals**2, axis=(1, 2)) / 2 * (count - 1) / (count - 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        shrink = np.sqrt(np.clip(1 - twice / np.diag(jackknife), 0.5, 1.0))
    return jackknife * np.outer(shrink, shrink)


def _cross_terms(blocks, plus, minus, weight):
    """R_km: the functions for pairs of one source in block k and another in block m, (k, blocks, blocks)."""
    lmax = blocks[0].lmax
    modes, scalar = Modes(lmax), ScalarModes(lmax)
    motions = np.array([block.motions for block in blocks]) / np.sqrt(modes.norm2)
    weights = np.array([block.weights for block in blocks]) / np.sqrt(scalar.norm2)
    self_pairs = np.array([block.alone for block in blocks])
    terms = np.zeros((len(plus), len(blocks), len(blocks)))
    for l in range(lmax + 1):
        y = weights[:, scalar.slice_of("F", l)]
        w = y @ y.T - np.diag(self_pairs[:, 1] * (2 * l + 1) / (4 * np.pi))
        terms += weight[:, l, None, None] * w
        if l == 0:
            continue
        t, s = (motions[:, modes.slice_of(kind, l)] for kind in modes.kinds)
        tt, ss, itself = t @ t.T, s @ s.T, np.diag(self_pairs[:, 0] * (2 * l + 1) / (4 * np.pi))
        terms += plus[:, l - 1, None, None] * (tt + ss - itself) + minus[:, l - 1, None, None] * (tt - ss)
    return terms


@dataclass(frozen=True, eq=False, repr=False)
class PairPower(Result):
    """Power of the motions by kind and degree, from pairs of different sources.

    Attributes
    ----------
    toroidal, spheroidal : (lmax,) arrays
        P_T and P_S of degrees 1 … lmax; as often below the truth as above. [(µas/yr)²]
    covariance : (2 lmax, 2 lmax) array
        Covariance of both, by the scatter of blocks and their pairs; nan of less than four. [(µas/yr)⁴]
    n_blocks : int
        How many blocks.
    n_data : int
        Two a source.
    notes : tuple of str
    """

    toroidal: FloatArray
    spheroidal: FloatArray
    covariance: FloatArray
    n_blocks: int
    n_data: int
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<PairPower: degree 1 to {len(self.toroidal)}, {self.n_data // 2} sources>"

    @property
    def errors(self) -> FloatArray:
        """Standard errors of both, (2, lmax). [(µas/yr)²]"""
        return np.sqrt(np.diag(self.covariance)).reshape(2, -1)

    def _sections(self, long):
        facts = [
            ("sources", f"{self.n_data // 2}; pairs of different sources have no noise in common, whatever the errors"),
            ("errors", f"from the scatter of {self.n_blocks} blocks of the sky"),
        ]
        return (Section("Power by degree from pairs", facts, self.to_table(), notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each degree, as an astropy Table."""
        columns = {
            "l": np.arange(1, len(self.toroidal) + 1),
            "toroidal": self.toroidal,
            "sigma_toroidal": self.errors[0],
            "spheroidal": self.spheroidal,
            "sigma_spheroidal": self.errors[1],
        }
        units = dict.fromkeys([name for name in columns if name != "l"], "uas2 / yr2")
        return tables.table_of(columns, self._plain_facts(), units)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Power by degree on matplotlib axes."""
        from fit.pairs._plot import plot_power

        return plot_power(self, ax=ax)


@arguments.accepts(field=arguments.a(Field, Parts), lmax=arguments.whole, nside=arguments.whole)
@explained
def power(
    field: Field | Parts, lmax: int, *, nside: int = 2, weights: ArrayLike | None = None, threads: int | None = None
) -> PairPower:
    """Power of the motions by kind and degree, from the correlation of pairs at all angles.

    Errors of sources add no bias, whatever their size, nor does the coverage of the sky on average over fields that
    prefer no direction (one glide, seen on part of the sky, is another matter: fit it); degrees beyond `lmax` leak in
    where the coverage is uneven. Where errors are right, a fit's powers are the more precise ones (`fit.spectrum`).

    Parameters
    ----------
    field, nside, weights, threads
        As for `fit.pairs.correlation_function`.
    lmax : int
        The highest degree.

    Raises
    ------
    DegeneracyError
        If the pairs cannot separate the degrees: part of the sky alone.

    Notes
    -----
    ξ± of all pairs fitted by Σ P_l d^l/4π with the weights of the pairs for weights, which is the pseudo-spectrum freed
    of the sky's coverage (Hivon et al. 2002, ApJ 567, 2).

    Examples
    --------
    >>> from vsh import Coefficients
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 3000), np.arcsin(rng.uniform(-1, 1, 3000))
    >>> glide = Coefficients.from_vectors(glide=(0, 0, 3.0)).at(lon, lat)
    >>> result = power(Field(lon, lat, glide + rng.normal(size=(2, 3000)), np.full((2, 3000), 0.1)), 2)
    >>> bool(abs(result.spheroidal[0] / (8 * np.pi / 3 * 9) - 1) < 0.05)
    True
    """
    total, blocks, _, notes = sums_of(field, 2 * lmax, nside, weights, threads)
    x, w = leggauss(2 * lmax + 2)
    theta, pairs = np.arccos(x), legvander(x, 2 * lmax).T
    *spectra, weight, _ = total.spectra
    normalisation = 4 * np.pi / (2 * np.arange(1, lmax + 1) + 1)
    rows, by_degree, by_weight = [], [], []
    for curve, spectrum in zip((d_plus(lmax, theta), d_minus(lmax, theta)), spectra, strict=True):
        inverse = _inverse(curve * (w * (weight @ pairs) / 2) @ curve.T)
        rows.append(inverse @ (spectrum[:lmax] * normalisation))
        by_degree.append(np.pad(inverse * normalisation, ((0, 0), (0, lmax))))
        by_weight.append(-(inverse @ curve * (w * (rows[-1] @ curve) / 2)) @ pairs.T)
    # From T + S and T − S to T and S.
    plus, minus = np.tile(by_degree[0], (2, 1)) / 2, np.vstack([by_degree[1], -by_degree[1]]) / 2
    weight_terms = np.vstack([by_weight[0] + by_weight[1], by_weight[0] - by_weight[1]]) / 2
    covariance = covariance_of(blocks, plus, minus, weight_terms)
    toroidal, spheroidal = (rows[0] + rows[1]) / 2, (rows[0] - rows[1]) / 2
    return PairPower(toroidal, spheroidal, covariance, len(blocks), 2 * round(float(total.alone[2])), notes)


def _inverse(matrix):
    if not 1 / np.linalg.cond(matrix) > 1e-6:
        raise DegeneracyError(
            f"pairs of these sources cannot tell {len(matrix)} degrees apart: lower lmax, or take more of the sky "
            "(fit.pairs.correlation_function asks for no pairs at all angles)"
        )
    return np.linalg.inv(matrix)


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


def windows(edges: FloatArray, lmax: int) -> Windows:
    """The bins between edges."""
    return _windows(tuple(map(float, edges)), lmax)


@lru_cache(maxsize=4)
def _windows(edges, lmax):
    theta, weight, ramp = [], [], []
    for lower, upper in pairwise(edges):
        x, w = leggauss(24 + int(0.7 * lmax * (upper - lower)))
        theta.append(lower + (upper - lower) * (x + 1) / 2)
        weight.append(w * (upper - lower) / 2 * np.sin(theta[-1]))
        ramp.append(np.sin(np.pi / 4 * (x + 1)) ** 2)
    nodes = np.concatenate(theta)
    starts = np.concatenate([[0], np.cumsum([len(angles) for angles in theta])])
    values = np.zeros((len(edges) - 2, len(nodes)))
    for k, row in enumerate(values):
        row[starts[k] : starts[k + 1]] = ramp[k] * weight[k]
        row[starts[k + 1] : starts[k + 2]] = (1 - ramp[k + 1]) * weight[k + 1]
    return Windows(nodes, values, d_plus(lmax, nodes), d_minus(lmax, nodes), legvander(np.cos(nodes), lmax).T)


def checked_edges(edges: ArrayLike) -> FloatArray:
    """Edges of bins, ascending from 0 to π at most."""
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
