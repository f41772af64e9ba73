"""Errors of sums over pairs, from how the sums of blocks of the sky scatter.

What is estimated is a sum over pairs of blocks, R_kk + Σ R_km. Leaving out block after block, as the jackknife does, counts
what a pair of blocks scatters by twice, once with each of them (Efron & Stein 1981, Ann. Stat. 9, 586): without a signal,
errors come out √2 too large. The scatter of the pairs themselves, free of what their blocks have in common, is therefore
taken off once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fit.pairs._sums import PairSums
from vsh.checks.types import FloatArray
from vsh.modes import Modes, ScalarModes


def covariance_of(blocks: Sequence[PairSums], plus: FloatArray, minus: FloatArray, weight: FloatArray) -> FloatArray:
    """The covariance of k linear functions of the spectra of pairs, (k, k); nan of less than four blocks."""
    count = len(blocks)
    if count < 4:
        return np.full((len(plus),) * 2, np.nan)
    between = _between(blocks, plus, minus, weight)
    itself = np.einsum("bkk->bk", between)
    pairs = 2 * between
    pairs[:, range(count), range(count)] = 0.0
    leaving = itself + pairs.sum(2)
    away = leaving - leaving.mean(1, keepdims=True)
    jackknife = count / (count - 1) * away @ away.T
    # Of each pair of blocks what neither of the two has with all others.
    own = pairs.sum(2) / (count - 2)
    mean = own.sum(1) * (count - 2) / (count - 1) / count
    rest = pairs - own[:, :, None] - own[:, None, :] + (mean * count / (count - 2))[:, None, None]
    rest[:, range(count), range(count)] = 0.0
    twice = np.sum(rest**2, axis=(1, 2)) / 2 * (count - 1) / (count - 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        shrink = np.sqrt(np.clip(1 - twice / np.diag(jackknife), 0.5, 1.0))
    return jackknife * np.outer(shrink, shrink)


def _between(blocks, plus, minus, weight):
    """R_km: the functions for pairs of one source in block k and another in block m, (k, blocks, blocks)."""
    lmax = blocks[0].lmax
    modes, scalar = Modes(lmax), ScalarModes(lmax)
    motions = np.array([block.motions for block in blocks]) / np.sqrt(modes.norm2)
    weights = np.array([block.weights for block in blocks]) / np.sqrt(scalar.norm2)
    alone = np.array([block.alone for block in blocks])
    out = np.zeros((len(plus), len(blocks), len(blocks)))
    for l in range(lmax + 1):
        y = weights[:, scalar.slice_of("F", l)]
        w = y @ y.T - np.diag(alone[:, 1] * (2 * l + 1) / (4 * np.pi))
        out += weight[:, l, None, None] * w
        if l == 0:
            continue
        t, s = (motions[:, modes.slice_of(kind, l)] for kind in modes.kinds)
        tt, ss, itself = t @ t.T, s @ s.T, np.diag(alone[:, 0] * (2 * l + 1) / (4 * np.pi))
        out += plus[:, l - 1, None, None] * (tt + ss - itself) + minus[:, l - 1, None, None] * (tt - ss)
    return out
