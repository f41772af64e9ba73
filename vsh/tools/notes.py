"""What a reader of a result should know of its data: lines of text that travel with it and add up.

Notes are strings. Some also count: rows that were left out, sources without a redshift, notes too many to list.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np

from vsh.tools.types import ArrayLike

#: Codes of notes: numbers that cannot be redshifts, errors or correlations that were assumed, anything to be warned of.
NO_REDSHIFTS, ASSUMED_MOTIONS, DOUBT = "no redshifts", "assumed of motions", "doubt"
#: That of a unit that was assumed, where a table states none at all.
ASSUMED_UNITS = "assumed units"
#: The code of the note that a column may hold the correlations that were taken as zero.
UNUSED_CORRELATIONS = "unused correlations"
#: What is asked where numbers cannot be redshifts.
VELOCITIES = "velocities in km/s? Say so, units= (--units NAME=km/s)"
#: So many different notes are listed when tables are added up; the others are counted.
MAX_NOTES = 9


class CountedNote(str):
    """A note with a count, which adds up where parts of a catalogue do."""

    parts: dict[str, Any]
    counts: dict[str, int]
    total: int
    #: Whether parts without anything to count have such a note, too.
    complete = True

    def __new__(cls, parts):
        counts, total, names = {}, 0, []
        for reasons, n_rows, part_names in parts.values():
            total += n_rows
            names += part_names
            for reason, count in reasons.items():
                counts[reason] = counts.get(reason, 0) + count
        # A part without anything to count is not among those counted, so of several the total is not known.
        known_total = total if cls.complete or len(parts) == 1 else 0
        note = super().__new__(cls, cls.format_text(counts, known_total, names))
        note.parts, note.counts, note.total = parts, counts, total
        return note

    def __getnewargs__(self):
        return (self.parts,)

    @staticmethod
    def format_text(counts: Mapping[str, int], total: int, names: Sequence[str]) -> str:
        """Text of the note."""
        raise NotImplementedError

    @classmethod
    def of_table(
        cls, counts: Mapping[str, int], total: int, *arrays: ArrayLike, names: Sequence[str] = ()
    ) -> CountedNote:
        """The note on one table, known again by a hash of some of its arrays."""
        hasher = blake2b(digest_size=12)
        for array in arrays:
            hasher.update(np.ascontiguousarray(array).tobytes())
        return cls({hasher.hexdigest(): (dict(counts), int(total), tuple(names))})


class CodedNote(str):
    """A note with a code by which a program may ask for it, however it is worded."""

    code: str

    def __new__(cls, text: str, code: str) -> CodedNote:
        note = super().__new__(cls, text)
        note.code = code
        return note

    def __getnewargs__(self):
        return (str(self), self.code)


def has_code(note: object, *codes: str) -> bool:
    """Return whether a note has one of some codes."""
    return getattr(note, "code", None) in codes


def codes_of(notes: Iterable[str]) -> tuple[str, ...]:
    """The code of each note, empty for one that has none."""
    return tuple(getattr(note, "code", "") for note in notes)


def doubts_of(notes: Iterable[str]) -> list[tuple[str, str]]:
    """The notes of doubt as a line to quote, which is never sharper than they: one of those that differ by numbers."""
    doubts = {re.sub(r"\d[\d.e+]*", "", note): str(note) for note in reversed([*notes]) if has_code(note, DOUBT)}
    return [("doubt", "; ".join(text.removeprefix("warning: ") for text in reversed(doubts.values())))] * bool(doubts)


def add_codes(notes: Iterable[str], codes: Iterable[str]) -> tuple[str, ...]:
    """Notes with their codes, as `codes_of` gave them."""
    pairs = zip(notes, codes, strict=True)
    return tuple(CodedNote(note, code) if code else note for note, code in pairs)


class DroppedRows(CountedNote):
    """A note that says how many rows were left out and why."""

    @staticmethod
    def format_text(counts: Mapping[str, int], total: int, names: Sequence[str]) -> str:
        """Text of the note."""
        details = "; ".join(f"{reason}: {count}" for reason, count in counts.items())
        return f"left out {sum(counts.values())} of {total} rows{': ' if details else ''}{details}"


#: Why a condition does not hold: it is false, or not known.
FALSE, MISSING = "not so", "a value missing"


class UnselectedRows(CountedNote):
    """A note that says how many rows a condition selected, and how many it could not tell of."""

    @staticmethod
    def format_text(counts: Mapping[str, int], total: int, names: Sequence[str]) -> str:
        """Text of the note."""
        n_missing = counts.get(MISSING, 0)
        suffix = f", {n_missing} of the others with a value missing" if n_missing else ""
        return f"selected {total - sum(counts.values())} of {total} rows, where {names[0]}{suffix}"


class UnusableRedshifts(CountedNote):
    """A note that says how many sources have no redshift that can be used."""

    complete = False

    @staticmethod
    def format_text(counts: Mapping[str, int], total: int, names: Sequence[str]) -> str:
        """Text of the note."""
        n_lost = sum(counts.values())
        details = ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)
        examples = f" ({', '.join(names[:5])}{', …' if n_lost > 5 else ''})" if names else ""
        return (
            f"left out {n_lost}{f' of {total}' if total else ''} sources without a usable redshift: {details}{examples}"
        )


class MoreNotes(str):
    """A note that stands for others that are not listed."""

    hashes: frozenset[str]

    def __new__(cls, hashes):
        note = super().__new__(cls, f"and {len(hashes)} more notes on parts of the data, like those above")
        note.hashes = frozenset(hashes)
        return note

    def __getnewargs__(self):
        return (self.hashes,)


def merge_notes(*note_groups: Iterable[str]) -> tuple[str, ...]:
    """The notes of several tables as those of one: repeated lines once, dropped rows added up, at most ten lines."""
    plain_notes: dict[str, None] = {}
    parts_by_kind: dict[tuple[type[CountedNote], object], dict[str, Any]] = {}
    hashes: set[str] = set()
    for note in (note for group in note_groups for note in group):
        if isinstance(note, CountedNote):
            condition = next(iter(note.parts.values()))[2] if isinstance(note, UnselectedRows) else None
            parts_by_kind.setdefault((type(note), condition), {}).update(note.parts)
        elif isinstance(note, MoreNotes):
            hashes |= note.hashes
        else:
            plain_notes[note] = None
    lines = list(plain_notes)
    has_several_groups = sum(bool(group) for group in note_groups) > 1
    if hashes or (has_several_groups and len(lines) > MAX_NOTES - 1):
        first_lines = lines[: MAX_NOTES - 1]
        hashes |= {_hash_line(line) for line in lines[MAX_NOTES - 1 :]}
        hashes -= {_hash_line(line) for line in first_lines}
        lines = first_lines
    return (
        *lines,
        *(note_class(parts) for (note_class, _), parts in parts_by_kind.items()),
        *([MoreNotes(hashes)] if hashes else []),
    )


def drop_empty_notes(notes: Iterable[str]) -> tuple[str, ...]:
    """The notes of a result: without those that count nothing, which are there for the sum of several parts."""
    return tuple(
        note for note in notes if not (isinstance(note, CountedNote) and len(note.parts) > 1 and not note.counts)
    )


def count_dropped(notes: Iterable[str]) -> int:
    """Number of rows that were left out, from the notes."""
    return _count_noted_rows(notes, DroppedRows)


def count_unselected(notes: Iterable[str]) -> int:
    """Number of rows that a condition left out, from the notes."""
    return _count_noted_rows(notes, UnselectedRows)


def _count_noted_rows(notes, note_class):
    return sum((sum(note.counts.values()) for note in notes if isinstance(note, note_class)), 0)


def _hash_line(line):
    return blake2b(line.encode("utf-8", "replace"), digest_size=6).hexdigest()
