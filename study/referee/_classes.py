"""Classes of sources, compared by the errors quoted and with those that they share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc

from fit.background import SharedErrors, Verdict, shared, widened
from fit.quality import gls
from fit.solution import Solution
from fit.solving import solve
from study.referee._quasars import Quasars, degree_for
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import DegeneracyError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import BoolArray, FloatArray, Rng

#: What classes share is looked for to this degree, in no class of fewer sources.
_DEGREE, FEWEST = 5, 100
#: Draws of what is shared, again where few of them count: p-values of 200 and of 800 differ by a tenth of themselves.
_DRAWS = 200
#: Skies behind a p-value, which is multiplied by the number of checks: 1/40 000 is the smallest.
_SKIES = 40_000
Split = dict[str, BoolArray]


@dataclass(frozen=True, eq=False)
class Compared(InNotebook):
    """Classes: each fitted alone by the errors quoted, and all with what they share."""

    plain: list[Solution]
    shared: SharedErrors

    @cached_property
    def verdict(self) -> Verdict:
        """The largest difference after allowing for all, by skies enough for one p-value among many."""
        return self.shared.verdict(_SKIES)

    def at_face_value(self, kind: str | None = None) -> float:
        """p-value of spins ("T"), accelerations ("S") or both that are alike, by errors quoted and nothing shared."""
        part = {None: slice(0, 6), "T": slice(0, 3), "S": slice(3, 6)}[kind]
        values = np.array([_first(each)[0][part] for each in self.plain])
        covariance = np.zeros(2 * values.shape)
        for i, each in enumerate(self.plain):
            covariance[i, :, i, :] = _first(each)[1][part, part]
        misfit = gls(values, covariance.reshape(values.size, values.size), np.ones((len(values), 1)))[1]
        return float(chdtrc(values.size - values.shape[1], misfit))


def _first(solution):
    """Degree 1 of a solution, and its covariance."""
    at = np.flatnonzero(solution.modes.degrees == 1)
    return solution.values[at], solution.covariance[np.ix_(at, at)]


def compare(quasars: Quasars, split: Split, rng: Rng = 1, lmax: int | None = None) -> Compared:
    """Compare classes of sources.

    Parameters
    ----------
    quasars : Quasars
        The sources.
    split : dict of (n,) masks
        The classes, by name.
    rng : Generator or int
        The source of all randomness.
    lmax : int, optional
        Degree of the plain fits; that of the others is what the smallest class bears, 5 at most.

    Raises
    ------
    DegeneracyError
        If a class has too few sources.
    """
    kept = {name: mask for name, mask in split.items() if mask.sum() >= FEWEST}
    if len(kept) < 2:
        counts = ", ".join(f"{name}: {mask.sum()}" for name, mask in split.items())
        raise DegeneracyError(f"fewer than two classes of {FEWEST} sources ({counts})")
    degree = degree_for(min(mask.sum() for mask in kept.values()), _DEGREE, least=3)
    normals = [quasars.equations(mask, degree) for mask in kept.values()]
    plain = [solve(quasars.plain_equations(mask, lmax or degree)) for mask in kept.values()]
    wide = widened(normals, quasars.equations, kept.values())
    compared = shared(
        wide, range(2, degree + 1), labels=list(kept), draws=_DRAWS, noise_scale=quasars.is_scaled, rng=rng
    )
    return Compared(plain, compared)


def by_edges(values: FloatArray, edges: Sequence[float], name: str) -> Split:
    """Classes between edges."""
    inner = {f"{low:g} ≤ {name} < {high:g}": (values >= low) & (values < high) for low, high in pairwise(edges)}
    return {f"{name} < {edges[0]:g}": values < edges[0]} | inner | {f"{name} ≥ {edges[-1]:g}": values >= edges[-1]}


def by_parts(values: FloatArray, k: int, name: str) -> Split:
    """Classes of about as many sources each; sources without a value are in none."""
    known = np.unique(values[np.isfinite(values)])
    if len(known) < 2:
        raise DegeneracyError(f"{name} is the same for all sources")
    if len(known) <= k:
        return {f"{name} {value:g}": values == value for value in known}
    edges = np.unique(np.nanquantile(values, np.arange(1, k) / k))
    return by_edges(values, [float(f"{edge:.4g}") for edge in edges], name)


def halves(quasars: Quasars, frame: str) -> Split:
    """The two halves of the sky beside the equator of a frame."""
    lat = latitude(quasars, frame)
    return {f"northern {frame} half": lat >= 0, f"southern {frame} half": lat < 0}


def latitude(quasars: Quasars, frame: str) -> FloatArray:
    """Latitude of each source. [rad]"""
    field = quasars.field
    return angles(rotation_matrix(field.frame, frame) @ triad(field.lon, field.lat)[2])[1]
