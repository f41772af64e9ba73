"""A catalogue in parts, wherever they lie: it streams here, and sums run where the parts are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from vsh.checks.columns import MEASURED
from vsh.checks.notebook import InNotebook
from vsh.checks.weighed import Weighed
from vsh.errors import FieldError, NothingLeftError, ParameterError
from vsh.field import Field
from vsh.parts._engines import Engine, Here
from vsh.parts._work import LostNotes, Work, left_by
from vsh.sky.frames import check_frame
from vsh.system.progress import progress_bar

HERE = Here()
#: What of a source is not needed for its motion.
OPTIONAL = ("name", *MEASURED)
#: What tells how far a source is.
DISTANCES = MEASURED


@dataclass(frozen=True, eq=False, repr=False)
class Parts(InNotebook):
    """Sources in parts: made by `vsh.catalogue.parts`, or of Fields by `as_parts`.

    Attributes
    ----------
    pieces : tuple
        What the parts are read from: paths, tables, Fields, delayed objects of Dask.
    read : function
        (piece, roles) → iterator of Fields; `roles` are those of name, redshift, magnitude, … that are wanted.
    steps : tuple of functions
        Field → Field, applied to every block as it is read.
    engine : vsh.parts.Engine
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
            for block in self.read(self.engine.fetched(piece), OPTIONAL):
                field, _ = left_by(self.steps, block)
                if field is not None:
                    yield field

    def map(self, step: Callable[[Field], Field]) -> Parts:
        """The same parts with a further step, done where the parts are when they are read.

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
        """The same sources in another frame.

        Parameters
        ----------
        name : {"icrs", "galactic", "ecliptic"}
            The frame to turn to.
        """
        return self.map(_InFrame(check_frame(name)))

    def add_note(self, *notes: str) -> Parts:
        """The same sources with more that the reader of a result should know.

        Parameters
        ----------
        *notes
            Lines to add.
        """
        return self.map(_WithNotes(notes))

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
        NothingLeftError
            If no part has a source that can be used.
        FieldError
            If the function does not return what adds.
        TableError
            If a part cannot be read.
        """
        if not callable(function):
            raise ParameterError(
                f"what is summed is a function of a Field, not a {type(function).__name__}; for normal equations: "
                "fit.normal_equations(parts, modes)"
            )
        wanted = OPTIONAL if self.steps else tuple(role for role in OPTIONAL if role in set(roles))
        work = Work(self.read, self.steps, function, wanted, self.engine.threads)
        bar = progress_bar(total=len(self.pieces), words=words, shown=progress and len(self.pieces) > 1, unit=" parts")
        with bar:
            found = self.engine.total(work, self.pieces, bar.update)
        total: Any
        total, notes, sources = (None, LostNotes(), 0) if found is None else found
        if not sources:
            error = NothingLeftError(
                "no part holds a source that can be used: " + ("; ".join(notes) or "all are empty")
            )
            error.notes = tuple(notes)
            raise error
        if notes and hasattr(total, "add_note"):
            return total.add_note(*notes)
        if notes and isinstance(total, dict) and isinstance(total.get("notes"), list):
            total["notes"].append(tuple(notes))
        return total

    def has(self, role: str) -> bool:
        """Whether the first part has names, magnitudes, redshifts, …

        Parameters
        ----------
        role : str
            Which of them.
        """
        return getattr(next(iter(self)), role) is not None

    @property
    def in_memory(self) -> Any:
        """The field itself, where it is all in one and in memory; None otherwise."""
        (first, *others) = self.pieces or (None,)
        return first if isinstance(first, Weighed) and not others and not self.steps else None

    def counted(self) -> int:
        """How many sources there are; reads all of them."""
        return self.sum(len, roles=(), words="counting")


def as_parts(field: Any, kind: type = Field) -> Parts:
    """Parts as they are; a Field, or Fields in a list, as parts.

    Parameters
    ----------
    field : Parts, Field, or list or tuple of Fields
        The sources.
    kind : type
        Of the fields; Weighed where a ScalarField will do as well.

    Raises
    ------
    FieldError
        If it is none of these.
    """
    if isinstance(field, Parts):
        return field
    fields = (field,) if isinstance(field, kind) else tuple(field) if isinstance(field, list | tuple) else ()
    if not fields or not all(isinstance(each, kind) for each in fields):
        raise FieldError(f"a Field, a list of Fields, or parts of a catalogue, are wanted, not {type(field).__name__}")
    return Parts(fields, itself)


def itself(field: Field, roles: tuple[str, ...]) -> Iterator[Field]:
    """The reader of a part that is a Field."""
    yield field


@dataclass(frozen=True)
class _InFrame:
    name: str

    def __call__(self, field):
        return field.to_frame(self.name)


@dataclass(frozen=True)
class _WithNotes:
    notes: tuple[str, ...]

    def __call__(self, field):
        return field.add_note(*self.notes)
