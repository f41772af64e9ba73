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
        sums = field.sum(_summarise_block_coverage, roles=("name",), words="sky seen", progress=False)
    elif isinstance(field, Field | ScalarField) and len(field):
        sums = _summarise_coverage(field, field.lon, field.lat)
    else:
        return solution
    notes = [note for note in _iterate_coverage_notes(sums, solution.frame) if note not in solution.notes]
    return replace(solution, notes=(*solution.notes, *notes)) if notes else solution


def _iterate_coverage_notes(sums: _CoverageSums, frame: str) -> Iterable[str]:
    if (share := sums.largest_weight / sums.weight) > _LARGEST_SHARE:
        text = f"warning: {sums.label} has {100 * share:.4g} % of the weight of all sources: is its error right?"
        yield CodedNote(text, DOUBT)
    if n_repeats := len(sums.name_hashes) - len(np.unique(sums.name_hashes)):
        about = "" if sums.step == 1 else "about "
        rows = f"{about}{n_repeats * sums.step} rows repeat the name of a row in another part or block and are used as"
        yield CodedNote(f"warning: {rows} separate sources", DOUBT)
    if sums.n_repeats > _FEW_REPEATED * sums.n:
        rows = f"{sums.n_repeats} of {sums.n} rows are at the place of another: rows of one source are not independent"
        text = f"warning: {rows}, and errors from them are too small: keep one row of each source"
        yield CodedNote(text, REPEATED if sums.n_repeats > _REPEATED_SHARE * sums.n else DOUBT)
    chance_radius = np.arccos(2 * _GAP_CHANCE ** (1 / sums.n) - 1)
    for max_places in (400, 10_000):  # a few hundred tell of most skies that there is none
        radius, lon, lat = widest_gap(sums.lon, sums.lat, max_places)
        if radius < max(_WIDE_GAP, chance_radius):
            return
    place = ", ".join(f"{name} = {np.degrees(x):.0f}°" for name, x in zip(ANGLES[frame], (lon, lat), strict=True))
    yield CodedNote(
        f"warning: no source within {np.degrees(radius):.0f}° of {place}: a part of a file, or of the sky? What is "
        "said of the whole sky rests on the other part",
        ONE_SIDE,
    )


@dataclass(frozen=True, kw_only=True)
class _CoverageSums:
    """Places, weights, and one in `step` of the hashes of names, of sources that add up."""

    n: int
    weight: float
    largest_weight: float
    label: str
    lon: FloatArray
    lat: FloatArray
    name_hashes: Any
    step: int = 1
    n_repeats: int = 0

    def __add__(self, other: _CoverageSums) -> _CoverageSums:
        step = max(self.step, other.step)
        name_hashes = np.concatenate([self.name_hashes, other.name_hashes])
        while len(name_hashes := name_hashes[name_hashes % np.uint64(step) == 0]) > _MAX_NAMES:
            step *= 2
        lon, lat = (np.concatenate(pair) for pair in ((self.lon, other.lon), (self.lat, other.lat)))
        sample = select_share(_MAX_PLACES / (self.n + other.n), lon, lat)  # of those that either kept by the same draw
        return replace(
            self if self.largest_weight >= other.largest_weight else other,
            n=self.n + other.n,
            weight=self.weight + other.weight,
            lon=lon[sample],
            lat=lat[sample],
            name_hashes=name_hashes,
            step=step,
            n_repeats=self.n_repeats + other.n_repeats,
        )


def _summarise_coverage(field, lon, lat, name_hashes=()):
    weights = field.information
    heaviest = int(np.argmax(weights))
    names = getattr(field, "name", None)
    label = f"source {heaviest}" if names is None else one_line_text(names[heaviest])
    sample = select_share(_MAX_PLACES / len(lon), lon, lat) if len(lon) > _MAX_PLACES else slice(None)
    some_lon, some_lat = lon[sample], lat[sample]
    squares = np.unique(np.round(some_lon * np.cos(some_lat) / _PLACE_SIZE) + 1j * np.round(some_lat / _PLACE_SIZE))
    return _CoverageSums(
        n=len(field),
        weight=float(weights.sum()),
        largest_weight=float(weights[heaviest]),
        label=label,
        lon=lon,
        lat=lat,
        name_hashes=name_hashes,
        n_repeats=round((1 - len(squares) / max(1, len(some_lon))) * len(field)),
    )


def _summarise_block_coverage(field):
    """Summarise the coverage by a block: places of some of its sources, its weights, and the different names it has."""
    sample = select_share(_MAX_PLACES / len(field), field.lon, field.lat)
    names = np.unique(field.name) if field.name is not None else np.zeros(0, np.uint64)
    if names.dtype.kind not in "iu":
        hashes = (blake2b(str(name).encode(), digest_size=8).digest() for name in names if name)
        name_hashes = np.frombuffer(b"".join(hashes), np.uint64)
    else:
        name_hashes = names.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)  # Fibonacci's hash: multiples are spread
        name_hashes ^= name_hashes >> np.uint64(32)
    return _summarise_coverage(field, field.lon[sample], field.lat[sample], name_hashes)
