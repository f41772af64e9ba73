"""Two catalogues of the same sky: which source is which, and how they differ."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from vsh.checks.columns import MEASURED
from vsh.checks.types import IntArray
from vsh.errors import FieldError, FrameError, TableError
from vsh.field import Field
from vsh.sky.positions import Positions
from vsh.sky.sphere import triad
from vsh.units import DEGREE, UAS

__all__ = ["Counterparts", "match"]


class Counterparts(NamedTuple):
    """Which sources of two catalogues are the same.

    Attributes
    ----------
    a, b : (k,) int arrays
        Where each stands in either.
    ambiguous : int
        Sources left out for several counterparts.
    """

    a: IntArray
    b: IntArray
    ambiguous: int


def counterparts(a: Any, b: Any, *, by: Literal["name", "position"] = "name", radius: Any = None) -> Counterparts:
    """Which sources of two catalogues are the same, one to one, in the order of the first."""
    kinds = {type(each) for each in (a, b)}
    if kinds not in ({Positions}, {Field}):
        raise FieldError(
            "match two Positions or two Fields: " + " and ".join(type(x).__name__ for x in (a, b)) + " differ"
        )
    if a.frame != b.frame:
        raise FrameError(f"the catalogues are in {a.frame} and {b.frame}: take both to one frame")
    if not isinstance(by, str) or by not in ("name", "position"):
        raise FieldError(f'match by "name" or "position", not {by!r}')
    if kinds == {Positions}:
        b = b.at_epoch(a.epoch)
    (i, j), ambiguous = _by_name(a, b) if by == "name" else _by_position(a, b, 1.0 if radius is None else float(radius))
    if not len(i):
        other = 'position, by="position" (--by position)' if by == "name" else "name, or a larger radius"
        raise TableError(
            f"the catalogues have no source in common ({len(a)} and {len(b)}, matched by {by}): match them by {other}"
        )
    return Counterparts(i, j, ambiguous)


def match(
    a: Any,
    b: Any,
    *,
    by: Literal["name", "position"] = "name",
    radius: Any = None,
    pairs: Counterparts | None = None,
) -> Field:
    """The differences a − b of two catalogues, with the sum of their covariances.

    Parameters
    ----------
    a, b : Positions, or Fields
        Positions give differences of position, Δα cos δ and Δδ [µas], those of `b` carried to
        the epoch of `a` where both are known; Fields give differences of motion [µas/yr].
    by : {"name", "position"}
        By identifiers that are equal, or by the nearest position.
    radius : float, optional
        How far apart two positions of one source may be; 1 unless given. [arcsec]
    pairs : Counterparts, optional
        Of `counterparts` with the same `by`, where they are known already.

    Returns
    -------
    Field
        At the positions of `a`, one to one: a source with two possible counterparts is left
        out. Its notes count what was matched, ambiguous and left over.

    Raises
    ------
    TableError
        If nothing matches.
    FrameError
        If the catalogues stand in different frames.
    FieldError
        If they are not of one kind, or have no names to match by.
    """
    i, j, ambiguous = counterparts(a, b, by=by, radius=radius) if pairs is None else pairs
    positions = isinstance(a, Positions)
    b = b.at_epoch(a.epoch) if positions else b
    difference = _offsets(a, b, i, j) if positions else a.motion[:, i] - b.motion[:, j]
    covariance = _covariance(a, i) + _covariance(b, j)
    sigma = np.sqrt(covariance[:2])
    left = f"{len(a) - len(i)} of {len(a)} and {len(b) - len(j)} of {len(b)}"
    notes = [f"matched {len(i)} sources by {by}; left over {left}, {ambiguous} of them with several counterparts"]
    if positions and by == "name":
        far = int((np.hypot(*difference) > 1e6).sum())
        if far:
            notes.append(f"{far} of the pairs are more than 1 arcsec apart: are they the same sources?")
    extras: dict[str, Any] = {}
    if not positions:
        extras = {column: _pick(getattr(a, column), i) for column in MEASURED} | {"redshift_frame": a.redshift_frame}
    return Field(
        a.lon[i], a.lat[i], difference, sigma, covariance[2] / (sigma[0] * sigma[1]), name=_pick(a.name, i),
        frame=a.frame, notes=(*a.notes, *b.notes, *notes), **extras,
    )  # fmt: skip


def _by_name(a, b):
    if a.name is None or b.name is None:
        raise FieldError('a catalogue without names cannot be matched by name: use by="position"')
    if a.name.dtype.kind != b.name.dtype.kind and "U" in (a.name.dtype.kind, b.name.dtype.kind):
        raise FieldError(f"names of type {a.name.dtype} and {b.name.dtype} are never equal: make both text or numbers")
    once = []
    ambiguous = 0
    for each in (a, b):
        _, first, counts = np.unique(each.name, return_index=True, return_counts=True)
        once.append(first[counts == 1])
        ambiguous += int(counts[counts > 1].sum())
    _, i, j = np.intersect1d(a.name[once[0]], b.name[once[1]], assume_unique=True, return_indices=True)
    i, j = once[0][i], once[1][j]
    order = np.argsort(i)
    return (i[order], j[order]), ambiguous


def _by_position(a, b, radius):
    if not 0 < radius < 180 * 3600:
        raise FieldError(f"the radius of a match is an angle above zero, not {radius} arcsec")
    chord = 2 * np.sin(radius * DEGREE / 7200)
    from scipy.spatial import cKDTree  # half of what reading a bad file would take

    trees = [cKDTree(triad(each.lon, each.lat)[2].T) for each in (a, b)]
    pairs = trees[0].query_ball_tree(trees[1], chord)
    counts = np.array([len(each) for each in pairs])
    reverse = np.bincount([k for each in pairs for k in each], minlength=len(b))
    i = np.array([k for k, each in enumerate(pairs) if len(each) == 1 and reverse[each[0]] == 1], int)
    j = np.array([pairs[k][0] for k in i], int)
    found = np.count_nonzero(counts) + np.count_nonzero(reverse)
    return (i, j), int(found - 2 * len(i))


def _offsets(a, b, i, j):
    """Δα cos δ and Δδ along the local axes of a, (2, k). [µas]"""
    p, q, r = triad(a.lon[i], a.lat[i])
    # Differences of unit vectors lose nothing that matters: 1e-16 rad is 2e-5 µas.
    away = r - triad(b.lon[j], b.lat[j])[2]
    return np.stack([np.sum(away * p, 0), np.sum(away * q, 0)]) / UAS


def _covariance(catalogue, index):
    """Variances and covariance, (3, k)."""
    s1, s2 = catalogue.sigma[:, index]
    return np.stack([s1**2, s2**2, catalogue.rho[index] * s1 * s2])


def _pick(column, index):
    return None if column is None else column[index]
