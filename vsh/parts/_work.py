"""What is done with one part where it is: it is read, steps are taken, a function of its sources is summed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from vsh.checks import arguments
from vsh.checks.notes import merge_notes
from vsh.errors import FieldError, NothingLeftError, NothingSelectedError, TableError, VshError
from vsh.field import Field
from vsh.parts._add import added, label_of
from vsh.system.parallel import limited


def _through(steps, field):
    for step in steps:
        field = arguments.a(Field)("what a step returns", step(field))
    return field


def left_by(steps: tuple[Callable[[Field], Field], ...], block: Field) -> tuple[Field | None, LostNotes]:
    """What the steps leave of a block, None for nothing; and notes on what had no sources."""
    try:
        field = _through(steps, block)
    except NothingLeftError as error:  # there may be more in other blocks
        return None, LostNotes(error.notes)
    return (field, LostNotes()) if len(field) else (None, LostNotes(field.notes))


class LostNotes(list):
    """Notes of parts without a source; they add."""

    def __add__(self, other):
        return LostNotes(merge_notes(self, other))


def _named(piece, error):
    """What an error says, with the file that it is about."""
    name = label_of(piece)
    return str(error) if name in str(error) or isinstance(piece, Field) else f"{name}: {error}"


def _left_out(piece, error):
    """The error of a part all of whose rows are bad, with what can be done."""
    found = NothingLeftError(f'{_named(piece, error)}. Leave them out with on_bad="drop" (--on-bad drop)')
    found.notes = error.notes
    return found


@dataclass(frozen=True)
class Work:
    """The sum over one part: (sum, notes of what had no sources, number of sources)."""

    read: Callable[[Any, tuple[str, ...]], Iterator[Field]]
    steps: tuple[Callable[[Field], Field], ...]
    function: Callable[[Field], Any]
    roles: tuple[str, ...]
    threads: int | None

    def __call__(self, piece: Any) -> Any:
        """The sum."""
        total, notes, sources = None, LostNotes(), 0
        with limited(self.threads):
            try:
                for block in self.read(piece, self.roles):
                    field, lost = left_by(self.steps, block)
                    notes = notes + lost
                    if field is not None:
                        total, sources = added(total, self.function(field)), sources + len(field)
            except NothingLeftError as error:  # of the whole part: a reader hands on what is lost of some of it
                chosen = isinstance(error, NothingSelectedError)  # other parts may hold some
                if error.notes and not chosen and getattr(self.read, "on_bad", "drop") == "raise":
                    raise _left_out(piece, error) from error
                notes = notes + LostNotes(error.notes)
            except FieldError as error:
                raise FieldError(_named(piece, error)) from error
            except TableError as error:
                raise TableError(_named(piece, error)) from error
            except VshError:
                raise
            except Exception as error:  # of a step or of what is summed
                error.add_note(f"in the part {label_of(piece)}")
                raise
        return total, notes, sources
