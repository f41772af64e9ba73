"""The lines to quote and the sections of a result, from which text, page, LaTeX, JSON and files are made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vsh.tools.notebook import InNotebook
from vsh.tools.printing import labelled, printable
from vsh.tools.types import Table

__all__ = ["Answer", "Section", "text_of"]


@dataclass(frozen=True)
class Answer:
    """The lines to quote of a result.

    Attributes
    ----------
    lines : tuple of (str, str)
        Labels with their text: acceleration, spin, the distance from Gaia EDR3's acceleration, and what the errors
        are, which comes first where it is not the fit to quote. None where the fit is not of proper motions.

    Examples
    --------
    >>> answer = Answer((("acceleration", "not detected"), ("spin", "not detected")))
    >>> print(answer)
    acceleration   not detected
    spin           not detected
    >>> answer.sentence
    'acceleration not detected; spin not detected'
    """

    lines: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        # Screen, file and page alike: no name of a source may be a terminal's escape.
        lines = tuple((printable(label), printable(text)) for label, text in self.lines)
        object.__setattr__(self, "lines", lines)

    def __str__(self) -> str:
        return labelled(self.lines)

    @property
    def sentence(self) -> str:
        """All lines as one."""
        return "; ".join(f"{label} {text}" for label, text in self.lines)


@dataclass(frozen=True, eq=False)
class Section(InNotebook):
    """A section of a result.

    Attributes
    ----------
    title : str
        What it is about, in one line.
    facts : sequence of (str, str)
        Labels with the words that belong to them, above the table.
    table : Table or None
        Rows and columns with their units; the error of a column `x` is `x_error` or `sigma_x`, that of `value` is
        `sigma`. Files and JSON have all of it.
    columns : sequence of str
        The columns that text and page show; all unless given.
    rows : sequence of int, optional
        The rows that the text shows, in their order; all unless given.
    forms : dict of str to str
        How numbers of a column are printed where their errors do not say it: `{"value": ".3f"}`.
    remarks : sequence of str
        Sentences below the table.
    notes : sequence of str
        What the reader should know of the data.

    Examples
    --------
    >>> from astropy.table import Table
    >>> table = Table({"degree": [1, 2], "power": [5.0, 3.0], "power_error": [0.5, 0.5]})
    >>> print(Section("Power by degree", [("sources", "713")], table))
    Power by degree
    sources        713
      degree         power
           1   5.00 ± 0.50
           2   3.00 ± 0.50
    """

    title: str
    facts: Sequence[tuple[str, str]] = ()
    table: Table | None = None
    columns: Sequence[str] = ()
    rows: Sequence[int] | None = None
    forms: Mapping[str, str] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    notes: Sequence[Any] = ()

    def __str__(self) -> str:
        from vsh.io.tables import printed  # with astropy, which `--help` does not wait for

        lines = [self.title]
        if self.facts:
            lines.append(labelled(self.facts))
        if self.shown is not None:
            lines += aligned(*printed(self.shown, self.forms))
        lines += self.remarks
        if self.notes:
            lines += ["", "Notes", *(f"  - {note}" for note in dict.fromkeys(map(str, self.notes)))]
        return "\n".join(lines)

    @property
    def shown(self) -> Table | None:
        """The part of the table that the text shows."""
        if self.table is None:
            return None
        table = self.table[list(self.columns)] if self.columns else self.table
        return table if self.rows is None else table[np.asarray(self.rows, int)]


def text_of(sections: Iterable[Section]) -> str:
    """Text of sections, an empty line between them.

    Parameters
    ----------
    sections : iterable of Section
        In their order.
    """
    return "\n\n".join(map(str, sections)) + "\n"


def aligned(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: words to the left, numbers to the right, two spaces before the first column."""
    columns = list(zip(heads, *rows, strict=True))
    sides = ["<" if any(cell[:1].isalpha() for cell in column[1:]) else ">" for column in columns]
    forms = [f"{side}{max(map(len, column))}" for side, column in zip(sides, columns, strict=True)]
    return [f"  {'   '.join(map(format, line, forms))}".rstrip() for line in (heads, *rows)]
