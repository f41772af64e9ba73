"""A catalogue in parts, wherever they lie: it streams here, and sums run where the parts are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from operator import methodcaller
from typing import Any

import numpy as np

from vsh.field import MEASURED, Field, SourcesWithErrors
from vsh.io.parts._engines import EmptyPartNotes, Engine, InProcess, PartSum, apply_steps
from vsh.sky.frames import check_frame
from vsh.tools.errors import EmptyFieldError, EmptySelectionError, FieldError, FrameError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import progress_bar
from vsh.tools.subsample import select_share
from vsh.tools.types import ArrayLike, FloatArray, IntArray

HERE = InProcess()
#: What of a source is not needed for its motion.
OPTIONAL = ("name", *MEASURED)
#: What tells how far a source is.
DISTANCES = MEASURED


@dataclass(frozen=True, eq=False, repr=False)
class Parts(InNotebook):
    """Sources in parts: made by `vsh.io.catalogue.parts`, or of Fields by `as_parts`.

    Attributes
    ----------
    pieces : tuple
        What the parts are read from: paths, tables, Fields, delayed objects of Dask.
    read : function
        (piece, roles) → iterator of Fields; `roles` are those of name, redshift, magnitude, … that are expected.
    steps : tuple of functions
        Field → Field, applied to every block as it is read.
    engine : vsh.io.parts.Engine
        Where sums are computed.
    """

    pieces: tuple
    read: Callable[[Any, tuple[str, ...]], Iterator[Field]]
    steps: tuple[Callable[[Field], Field], ...] = ()
    engine: Engine = HERE

    def __repr__(self) -> str:
        return f"<Parts: {len(self.pieces)}, summed {self.engine}>"

    def __len__(self) -> int:
        return len(self.pieces)

    def __iter__(self) -> Iterator[Field]:
        """The fields one after the other, a block of sources at a time, in this process."""
        for piece in self.pieces:
            with suppress(EmptySelectionError):  # others may hold some
                for block in self.read(self.engine.fetched(piece), OPTIONAL):
                    field, _ = apply_steps(self.steps, block)
                    if field is not None:
                        yield field

    def map(self, step: Callable[[Field], Field]) -> Parts:
        """Add a step, which is done where the parts are when they are read.

        Parameters
        ----------
        step : function
            Field → Field, source by source: it sees a block of sources at a time. For other processes it must be
            a function that they can import, unless Dask sends it.

        Raises
        ------
        ParameterError
            If it is no function.
        """
        if not callable(step):
            raise ParameterError(f"a step is a function from a Field to a Field, not a {type(step).__name__}")
        return replace(self, steps=(*self.steps, step))

    def to_frame(self, name: str) -> Parts:
        """Turn the sources to the frame `name`: icrs, galactic or ecliptic."""
        return self.map(methodcaller("to_frame", check_frame(name)))

    def add_note(self, *notes: str) -> Parts:
        """Add `notes` that the reader of a result should know."""
        return self.map(methodcaller("add_note", *notes))

    def sum(
        self,
        function: Callable[[Field], Any],
        *,
        roles: Iterable[str] = OPTIONAL,
        words: str = "parts",
        progress: bool = True,
    ) -> Any:
        """The sum of a function over all sources, computed where the parts are.

        Parameters
        ----------
        function : function
            From a Field, some of the sources, to anything that adds: arrays, normal equations, moments; dicts and
            tuples of them; None for nothing. Notes on parts without a usable source go to the `add_note` of the sum,
            or to its list "notes".
        roles : iterable of str
            Those of name, redshift, magnitude, … that the function looks at. (Steps see all.)
        words : str
            Beside the progress bar.
        progress : bool
            Show a bar, after two seconds.

        Returns
        -------
        object
            Added up in a fixed tree: the same bits however many workers there are and whichever is first.

        Raises
        ------
        EmptyFieldError
            If no part has a source that can be used.
        ParameterError
            If it is not a function.
        TableError
            If a part cannot be read.
        """
        if not callable(function):
            raise ParameterError(
                f"what is summed is a function of a Field, not a {type(function).__name__}; for normal equations: "
                "fit.normal_equations(parts, modes)"
            )
        read_roles = OPTIONAL if self.steps else tuple(role for role in OPTIONAL if role in set(roles))
        part_sum = PartSum(self.read, self.steps, function, read_roles, self.engine.threads)
        bar = progress_bar(total=len(self.pieces), words=words, shown=progress and len(self.pieces) > 1, unit=" parts")
        with bar:
            sum_and_notes = self.engine.total(part_sum, self.pieces, bar.update)
        total: Any
        total, notes, n_sources = (None, EmptyPartNotes(), 0) if sum_and_notes is None else sum_and_notes
        if not n_sources:
            error = EmptyFieldError("no part holds a source that can be used: " + ("; ".join(notes) or "all are empty"))
            error.notes = tuple(notes)
            raise error
        if notes and hasattr(total, "add_note"):
            return total.add_note(*notes)
        if notes and isinstance(total, dict) and isinstance(total.get("notes"), list):
            total["notes"].append(tuple(notes))
        return total

    def has(self, role: str) -> bool:
        """Return whether the first part has a `role`: names, magnitudes, redshifts, …"""
        return getattr(next(iter(self)), role) is not None

    @property
    def in_memory(self) -> Any:
        """The field itself, where it is all in one and in memory; None otherwise."""
        (piece, *remainder) = self.pieces or (None,)
        return piece if isinstance(piece, SourcesWithErrors) and not remainder and not self.steps else None

    def counted(self) -> int:
        """Count the sources; reads all of them."""
        return self.sum(len, roles=(), words="counting")


def as_parts(field: Any, source_class: type = Field) -> Parts:
    """Parts as they are; a Field, or Fields in a list, as parts."""
    if isinstance(field, Parts):
        return field
    fields = (field,) if isinstance(field, source_class) else tuple(field) if isinstance(field, list | tuple) else ()
    if not fields or not all(isinstance(field, source_class) for field in fields):
        raise FieldError(f"a Field, a list of Fields, or parts of a catalogue are expected, not {type(field).__name__}")
    return Parts(fields, yield_field)


def apply_step(field: Any, step: Callable[[Any], Any]) -> Any:
    """Sources after a step: done at once where they are in memory, and where they are read of other parts."""
    if not isinstance(field, Parts):
        return step(field)
    return field.map(step) if field.in_memory is None else as_parts(step(field.in_memory), SourcesWithErrors)


def yield_field(field: Field, roles: tuple[str, ...]) -> Iterator[Field]:
    """The reader of a part that is a Field."""
    yield field


def check_fields_or_parts(name: str, value: Any) -> Any:
    """A Field, Parts, or a list, tuple or stream of Fields."""
    is_list_of_fields = isinstance(value, (list, tuple)) and value and all(isinstance(field, Field) for field in value)
    if isinstance(value, Field | Parts) or is_list_of_fields or hasattr(value, "__next__"):
        return value
    raise ParameterError(f"{name} must be a Field, or a list or stream of Fields, not {type(value).__name__}")


#: Bins: 512 in every factor of two, from 2⁻⁶⁴ to 2⁶⁴. What lies beyond is in the first and the last.
BINS = 2**16
_BITS_OF_BIN, _LOWEST_EXPONENT = 9, 1023 - 64


def median(sky: Parts, numbers: Callable[[Field], FloatArray], words: str = "median") -> float:
    """The median over all sources, as np.median gives it for all at once."""
    if sky.in_memory is not None:
        return float(np.median(numbers(sky.in_memory)))
    bin_weights = sky.sum(partial(_sum_weights_by_bin, numbers=numbers, weights=None), roles=(), words=words)
    n = int(bin_weights.sum())
    ranks = [(n + 1) // 2, n // 2 + 1]
    return float(np.mean(_find_numbers_at_weights(sky, numbers, None, bin_weights, ranks, (), words)))


def weighted_quantiles(
    sky: Parts,
    numbers: Callable[[Field], FloatArray],
    weights: Callable[[Field], FloatArray],
    shares: ArrayLike,
    *,
    roles: Iterable[str] = (),
    words: str = "quantiles",
) -> FloatArray:
    """Weighted quantiles: for each share, the least value up to which sources have that share of the weight."""
    totals = sky.sum(partial(_sum_weights_by_bin, numbers=numbers, weights=weights), roles=roles, words=words)
    return _find_numbers_at_weights(sky, numbers, weights, totals, np.asarray(shares) * totals.sum(), roles, words)


def _find_numbers_at_weights(sky, numbers, weights, bin_weights, target_weights, roles, words):
    """Find the numbers at which the cumulative weight reaches the targets."""
    cumulative_weight = np.cumsum(bin_weights)
    bins = np.searchsorted(cumulative_weight, np.minimum(target_weights, cumulative_weight[-1]))
    target_bins = np.unique(bins)
    contents = sky.sum(
        partial(_select_numbers_in_bins, numbers=numbers, weights=weights, bins=target_bins), roles=roles, words=words
    )
    numbers_at_targets = []
    for bin_, target_weight in zip(bins, target_weights, strict=True):
        numbers_in_bin, weights_in_bin = (np.concatenate(column) for column in zip(*contents[int(bin_)], strict=True))
        order = np.argsort(numbers_in_bin, kind="stable")
        weight_below = cumulative_weight[bin_] - bin_weights[bin_]
        index = np.searchsorted(weight_below + np.cumsum(weights_in_bin[order]), target_weight)
        numbers_at_targets.append(numbers_in_bin[order[min(index, len(order) - 1)]])
    return np.array(numbers_at_targets)


def find_number_bins(numbers: FloatArray) -> IntArray:
    """Find the bin of each number: a larger one is never in a lower bin, whatever the rounding of logarithms."""
    bits = np.ascontiguousarray(numbers, float).view(np.int64) >> (52 - _BITS_OF_BIN)
    return np.clip(bits - (_LOWEST_EXPONENT << _BITS_OF_BIN), 0, BINS - 1)


def _sum_weights_by_bin(field, numbers, weights):
    field_weights = None if weights is None else weights(field)
    return np.bincount(find_number_bins(numbers(field)), field_weights, BINS)


def _select_numbers_in_bins(field, numbers, weights, bins):
    """Select numbers and weights of the sources in some bins, a list for each, which grow by the parts."""
    field_numbers = numbers(field)
    field_weights = np.ones(len(field_numbers)) if weights is None else weights(field)
    bin_of_number = find_number_bins(field_numbers)
    return {int(bin_): [(field_numbers[bin_of_number == bin_], field_weights[bin_of_number == bin_])] for bin_ in bins}


def sample_of(sky: Parts, n_sources: int = 20_000, total: int | None = None, draw: int = 0) -> Any:
    """Some of the sources as a Field, by their places; of `total`, where it is known; a draw as for `select_share`."""
    share = n_sources / max(total or sky.counted(), 1)
    if (field := sky.in_memory) is not None:
        return _select_source_share(field, share, draw)
    columns: dict[str, Any] = sky.sum(partial(_draw_sample_columns, share=share, draw=draw), roles=(), words="a sample")
    frames = columns.pop("frame")
    arrays: dict[str, Any] = {name: np.concatenate(values, axis=-1) for name, values in columns.items()}
    return Field(**arrays, frame=find_single_frame(frames))


def find_single_frame(frames: Iterable[str]) -> str:
    """Find the frame that all parts are in; FrameError where there are several."""
    distinct_frames = sorted(set(frames))
    if len(distinct_frames) > 1:
        raise FrameError(f"parts are in several frames: {', '.join(distinct_frames)}")
    return distinct_frames[0]


def _select_source_share(field, share, draw):
    """Choose a share of the sources by their places to a nanoradian: tables in degrees change the last bits."""
    return field[select_share(share, np.round(field.lon, 9), np.round(field.lat, 9), draw=draw)]


def _draw_sample_columns(field, share, draw):
    sample = _select_source_share(field, share, draw)
    return {name: [getattr(sample, name)] for name in ("lon", "lat", "motion", "sigma", "rho", "frame")}
