"""Notes on sources that see one side of the sky, of which one has most of the weight, or that a catalogue has twice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any

import numpy as np

from fit.results.quality import ONE_SIDE, REPEATED
from vsh import Field
from vsh.io.parts import Parts
from vsh.scalars import ScalarField
from vsh.sky.frames import ANGLES
from vsh.sky.sphere import widest_gap
from vsh.tools.notes import DOUBT, CodedNote
from vsh.tools.printing import one_line_text
from vsh.tools.subsample import select_share
from vsh.tools.types import FloatArray

#: A part of the sky without sources that is wider than this is worth a word [rad], and a source with more than this
#: share of the weight.
_WIDE_GAP, _LARGEST_SHARE = np.radians(60), 0.5
#: Rows in one square of an arcsecond are of one source [rad]; where they are more than this share of all, errors that
#: take them as independent are wrong.
_PLACE_SIZE, _REPEATED_SHARE, _FEW_REPEATED = np.radians(1 / 3600), 0.2, 0.01
#: Few sources leave wide parts empty by chance: one about a given point is worth a word if that has this probability.
_GAP_CHANCE = 1e-5
#: So many places of a catalogue in parts are kept, and so many names to find those that stand twice.
_MAX_PLACES, _MAX_NAMES = 20_000, 4_000_000


def add_coverage_notes(solution: Any, field: Any) -> Any:
    """The solution with a note where a large part of the sky has no source, or one source most of the weight.

    Parts are gone through once for it, and sources are noted that stand in several blocks of them.
    """
    if isinstance(field, Parts):
        sums = field.sum(_summarise_block, roles=("name",), words="sky seen", progress=False)
    elif isinstance(field, Field | ScalarField) and len(field):
        sums = _summarise_places(field, field.lon, field.lat)
    else:
        return solution
    notes = [note for note in _iterate_notes(sums, solution.frame) if note not in solution.notes]
    return replace(solution, notes=(*solution.notes, *notes)) if notes else solution


def _iterate_notes(sums: _CoverageSums, frame: str) -> Iterable[str]:
    if (share := sums.largest / sums.weight) > _LARGEST_SHARE:
        yield f"warning: {sums.label} has {100 * share:.4g} % of the weight of all sources: is its error right?"
    if n_repeats := len(sums.keys) - len(np.unique(sums.keys)):
        about = "" if sums.every == 1 else "about "
        rows = f"{about}{n_repeats * sums.every} rows repeat the name of a row in another part or block and are used as"
        yield CodedNote(f"warning: {rows} separate sources", DOUBT)
    if sums.n_repeats > _FEW_REPEATED * sums.n:
        rows = f"{sums.n_repeats} of {sums.n} rows are at the place of another: rows of one source are not independent"
        text = f"warning: {rows}, and errors from them are too small: keep one row of each source"
        yield CodedNote(text, REPEATED if sums.n_repeats > _REPEATED_SHARE * sums.n else DOUBT)
    by_chance = np.arccos(2 * _GAP_CHANCE ** (1 / sums.n) - 1)
    for max_places in (400, 10_000):  # a few hundred tell of most skies that there is none
        radius, lon, lat = widest_gap(sums.lon, sums.lat, max_places)
        if radius < max(_WIDE_GAP, by_chance):
            return
    place = ", ".join(f"{name} = {np.degrees(x):.0f}°" for name, x in zip(ANGLES[frame], (lon, lat), strict=True))
    yield CodedNote(
        f"warning: no source within {np.degrees(radius):.0f}° of {place}: a part of a file, or of the sky? What is "
        "said of the whole sky rests on the other part",
        ONE_SIDE,
    )


@dataclass(frozen=True, kw_only=True)
class _CoverageSums:
    """Places, weights, and one in `every` of the hashes of names, of sources that add up."""

    n: int
    weight: float
    largest: float
    label: str
    lon: FloatArray
    lat: FloatArray
    keys: Any
    every: int = 1
    n_repeats: int = 0

    def __add__(self, other: _CoverageSums) -> _CoverageSums:
        every = max(self.every, other.every)
        keys = np.concatenate([self.keys, other.keys])
        while len(keys := keys[keys % np.uint64(every) == 0]) > _MAX_NAMES:
            every *= 2
        lon, lat = (np.concatenate(pair) for pair in ((self.lon, other.lon), (self.lat, other.lat)))
        kept = select_share(_MAX_PLACES / (self.n + other.n), lon, lat)  # of those that either kept by the same draw
        return replace(
            self if self.largest >= other.largest else other,
            n=self.n + other.n,
            weight=self.weight + other.weight,
            lon=lon[kept],
            lat=lat[kept],
            keys=keys,
            every=every,
            n_repeats=self.n_repeats + other.n_repeats,
        )


def _summarise_places(field, lon, lat, keys=()):
    weight = field.information
    heaviest = int(np.argmax(weight))
    names = getattr(field, "name", None)
    label = f"source {heaviest}" if names is None else one_line_text(names[heaviest])
    sample = select_share(_MAX_PLACES / len(lon), lon, lat) if len(lon) > _MAX_PLACES else slice(None)
    x, y = lon[sample], lat[sample]
    places = np.unique(np.round(x * np.cos(y) / _PLACE_SIZE) + 1j * np.round(y / _PLACE_SIZE))
    return _CoverageSums(
        n=len(field),
        weight=float(weight.sum()),
        largest=float(weight[heaviest]),
        label=label,
        lon=lon,
        lat=lat,
        keys=keys,
        n_repeats=round((1 - len(places) / max(1, len(x))) * len(field)),
    )


def _summarise_block(field):
    """Summarise the places of some sources of a block, its weights, and the different names it has."""
    kept = select_share(_MAX_PLACES / len(field), field.lon, field.lat)
    names = np.unique(field.name) if field.name is not None else np.zeros(0, np.uint64)
    if names.dtype.kind not in "iu":
        hashes = (blake2b(str(name).encode(), digest_size=8).digest() for name in names if name)
        keys = np.frombuffer(b"".join(hashes), np.uint64)
    else:
        keys = names.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)  # Fibonacci's hash: multiples are spread
        keys ^= keys >> np.uint64(32)
    return _summarise_places(field, field.lon[kept], field.lat[kept], keys)
