"""Rows of a referee's sections, papers (published.toml) beside them, and the acceleration with every known error."""

import re
import tomllib
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from fit.results.quality import SEEN
from vsh.tools.digits import format_p_value, format_with_error
from vsh.tools.notebook import InNotebook


@dataclass(frozen=True)
class Number(InNotebook):
    """A published number: `value` ± `error`, or a limit of 95 %; `where` says where in the paper it is."""

    of: str
    value: float
    error: float
    unit: str
    where: str
    limit: bool = False


@dataclass(frozen=True)
class Paper(InNotebook):
    """A paper, the data it used, what it found in `words`, and its numbers by name."""

    key: str
    reference: str
    arxiv: str
    data: str
    words: str
    numbers: dict[str, Number]

    @property
    def citation(self) -> str:
        """Its authors and year: the reference up to the year."""
        match = re.match(r"(?:Gaia Collaboration, )?(.*?\d{4})", self.reference)
        return match[1] if match else self.reference

    def __getitem__(self, name: str) -> Number:
        return self.numbers[name]


@cache
def read_papers() -> dict[str, Paper]:
    """The papers by key, in the order of the file."""
    entries = tomllib.loads((files("study") / "published.toml").read_text(encoding="utf-8"))
    return {
        key: Paper(
            key, entry["reference"], entry["arxiv"], entry["data"], entry.get("words", ""),
            {number["of"]: Number(**{"error": float("nan"), **number}) for number in entry.get("numbers", [])},
        )
        for key, entry in entries.items()
    }  # fmt: skip


#: What is less likely by chance is called a hint.
HINT = 0.05


class Value(NamedTuple):
    """A number with its error ("value"; "size" has no sign), a "limit" of 95 %, or a "p"."""

    value: float
    error: float = float("nan")
    kind: str = "value"

    def __str__(self) -> str:
        if not np.isfinite(self.value):
            return "–"
        if self.kind == "p":
            return f"p {format_p_value(self.value)}"
        if self.kind == "limit":
            return f"< {self.value:.3g}"
        if not np.isfinite(self.error):
            return f"{self.value:,.0f}".replace(",", " ") if abs(self.value) > 1e4 else f"{self.value:.4g}"
        return format_with_error(self.value, self.error, "" if self.kind == "size" else "+")


#: Nothing to say.
NO_VALUE = Value(float("nan"))


@dataclass(frozen=True)
class Row(InNotebook):
    """A number of a section: published, with the published method, and with systematic errors."""

    quantity: str
    published: Value = NO_VALUE
    theirs: Value = NO_VALUE
    shared: Value = NO_VALUE


@dataclass(frozen=True, eq=False)
class Analysis(InNotebook):
    """A published analysis, repeated.

    Attributes
    ----------
    title : str
    paper : Paper
    rows : tuple of Row
    verdict : str
        In words.
    p_value : float
        What the verdict rests on; nan where it is no test.
    lacking : str
        Why there is no result; empty where there is one.
    results : dict of str to Result
        What was fitted for it, by name; each can be plotted and written.
    """

    title: str
    paper: Paper
    rows: tuple[Row, ...] = ()
    verdict: str = ""
    p_value: float = float("nan")
    lacking: str = ""
    results: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Check(InNotebook):
    """A question of a referee.

    Attributes
    ----------
    key : str
        In a word.
    question : str
    answer : str
        The number behind the p-value, in words.
    p_value : float
        Probability of as much by chance, with systematic errors; nan where it could not be asked.
    at_face_value : float
        The same with formal errors; nan where there is none.
    lacking : str
        Why it could not be asked.
    results : dict of str to Result
    """

    key: str
    question: str
    answer: str = ""
    p_value: float = float("nan")
    at_face_value: float = float("nan")
    lacking: str = ""
    results: dict[str, Any] = field(default_factory=dict)


def format_verdict(p_value: float, null_text: str, finding_text: str) -> str:
    """A verdict in words by its p-value."""
    p_text = f"p = {format_p_value(p_value)}"
    if not p_value < HINT:  # nan, too
        return f"{null_text} ({p_text})"
    if p_value >= SEEN:
        return f"weak evidence: {finding_text} ({p_text}; by chance in one test of {1 / p_value:.0f})"
    return f"{finding_text} ({p_text})"
