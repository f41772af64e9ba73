"""Papers whose numbers stand beside ours: all of them are in published.toml."""

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

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
    def short(self) -> str:
        """Its authors and year: the reference up to the year."""
        match = re.match(r"(?:Gaia Collaboration, )?(.*?\d{4})", self.reference)
        return match[1] if match else self.reference

    def __getitem__(self, name: str) -> Number:
        return self.numbers[name]


@cache
def papers() -> dict[str, Paper]:
    """The papers by key, in the order of the file."""
    entries = tomllib.loads((files("study") / "published.toml").read_text(encoding="utf-8"))
    return {
        key: Paper(
            key, entry["reference"], entry["arxiv"], entry["data"], entry.get("words", ""),
            {number["of"]: Number(**{"error": float("nan"), **number}) for number in entry.get("numbers", [])},
        )
        for key, entry in entries.items()
    }  # fmt: skip
