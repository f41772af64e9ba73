"""Chances that trust no error: redshifts dealt out anew among the sources."""

import numpy as np

from fit.binned import equality_chi2, slope_chi2
from vsh.basis import harmonics
from vsh.modes import Modes
from vsh.redshifts import with_redshift


def chances_by_shuffling(field, binned, rounds=1000, rng=1):
    """How often redshifts that mean nothing give bins as unlike as these.

    Positions, motions and errors stay together; the redshifts are permuted. However wrong the
    errors, the share of permutations that give as large a χ² is an honest chance. For degree 1.

    Parameters
    ----------
    field : Field — that went into the bins
    binned : BinnedSolution — of degree 1
    rounds : int
    rng : Generator or int

    Returns
    -------
    dict of str to float
        "T" and "S": equality of spin and acceleration; "trend": no slope of both with redshift.
    """
    rng = np.random.default_rng(rng)
    field = with_redshift(field, 0.0)
    place = np.searchsorted(binned.edges, field.redshift, side="right") - 1
    inside = (place >= 0) & (place < len(binned))
    field, place = field[inside], place[inside]
    rows = np.concatenate([harmonics(field.lon, field.lat, Modes(1)), field.motion[None]])
    a, b, c = field.weights
    weighted = np.stack([a * rows[:, 0] + c * rows[:, 1], c * rows[:, 0] + b * rows[:, 1]], axis=1)
    products = np.einsum("ikn,jkn->nij", rows[:6], weighted).reshape(len(field), 42)
    degree = {kind: np.arange(6)[Modes(1).degree(kind, 1)] for kind in "TS"}
    counts = dict.fromkeys((*degree, "trend"), 0)
    observed = None
    for _ in range(rounds + 1):
        sums = np.stack([np.bincount(place, column, len(binned)) for column in products.T], axis=1).reshape(-1, 6, 7)
        covariance = np.linalg.inv(sums[..., :6])
        values = np.einsum("bij,bj->bi", covariance, sums[..., 6])
        found = {
            kind: equality_chi2(values[:, at], covariance[:, at][:, :, at]) for kind, at in degree.items()
        } | {"trend": slope_chi2(values, covariance, binned.redshift)}  # fmt: skip
        if observed is None:
            observed = found
        for name, chi2 in found.items():
            counts[name] += chi2 >= observed[name] * (1 - 1e-12)
        place = rng.permutation(place)
    return {name: count / (rounds + 1) for name, count in counts.items()}
