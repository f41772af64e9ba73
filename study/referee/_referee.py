"""All that a referee reads of one catalogue: the headline, the published analyses, the checks."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.results.output import Answer
from fit.results.quality import SEEN, printed_p_value
from study.referee._quasars import Quasars
from study.referee._rows import HINT, Check, Headline, Section, headline
from study.referee._sections import checks, sections
from vsh.field import Field
from vsh.io import tables
from vsh.tools.arguments import generator
from vsh.tools.notebook import InNotebook
from vsh.tools.types import Rng, Table

_WIDTH = 40
#: The paper whose result is that of the lines to quote.
_QUOTED = "klioner2021"
#: How many checks a short report lists, those with the smallest p-values.
_LISTED = 4


@dataclass(frozen=True, eq=False, repr=False)
class Referee(InNotebook):
    """What a careful colleague finds in a catalogue of motions of quasars.

    Attributes
    ----------
    quasars : Quasars
        The sources.
    headline : Headline
        The acceleration with every error that is known of.
    sections : list of Section
        Published analyses, each repeated.
    checks : list of Check
        Whether it is the sky or the instrument.
    """

    quasars: Quasars
    headline: Headline
    sections: list[Section]
    checks: list[Check]

    def __repr__(self) -> str:
        done = sum(not each.lacking for each in self.sections)
        return f"<Referee: {len(self.quasars.whole)} sources, {done} analyses, {len(self.checks)} checks>"

    @property
    def smallest(self) -> tuple[Check | None, float]:
        """The check with the smallest p-value, and that value times how many were asked (Bonferroni), 1 at most."""
        asked = [each for each in self.checks if np.isfinite(each.p_value)]
        if not asked:
            return None, 1.0
        worst = min(asked, key=lambda each: each.p_value)
        return worst, min(1.0, worst.p_value * len(asked))

    @property
    def answer(self) -> Answer:
        """The result to quote, that of the recommended fit, and whether a check contradicts it."""
        return Answer((*self.headline.fit.answer.lines, ("checks", self.conclusion)))

    @property
    def conclusion(self) -> str:
        """What the checks say together."""
        worst, p = self.smallest
        n = sum(bool(np.isfinite(each.p_value)) for each in self.checks)
        if worst is None:
            return "No check could be asked"
        if p >= HINT:
            return f"none of {n} contradicts it (the smallest p-value, times {n}: {printed_p_value(p)})"
        seen = "The instrument is seen" if p < SEEN else "A hint of the instrument, no more"
        rest = f"{worst.answer}; p = {printed_p_value(p)} after allowing for {n} checks"
        return f"{seen}, where it should be {worst.question} ({rest})"

    def report(self, *, long: bool = False) -> str:
        """The result to quote, what became of each analysis, and the checks, as text.

        Parameters
        ----------
        long : bool
            Add the numbers of each analysis beside the published ones, and every check.
        """
        return f"{self.answer}\n\n{self.details(long)}"

    def details(self, long: bool = True) -> str:
        """What stands below the result to quote, as text.

        Parameters
        ----------
        long : bool
            As for `report`.
        """
        quasars = self.quasars
        lines = [
            (
                f"{quasars.label}: {len(quasars.whole)} sources, {quasars.n_clipped} of them clipped where least "
                f"squares are used; {self.headline.solution.frame} axes; errors that sources share to degree "
                f"{self.headline.solution.modes.lmax}"
            )
        ]
        for section in self.sections if long else ():
            lines += ["", f"{section.title} — {section.paper.reference}"]
            if section.lacking:
                lines.append(f"  not done: {section.lacking}")
                continue
            lines.append(f"  {'':{_WIDTH}}{'published':>20}{'their way':>20}{'with shared errors':>20}")
            lines += [
                f"  {row.quantity:{_WIDTH}}{row.published!s:>20}{row.theirs!s:>20}{row.shared!s:>20}"
                for row in section.rows
            ]
            lines.append(f"  result: {section.verdict}")
        if not long:
            lines.append("")
            others = [each for each in self.sections if each.paper.key != _QUOTED]
            lines += [f"{each.paper.short}: {each.lacking or each.verdict}" for each in others]
        lines += ["", "Checks: p-values with systematic errors; in brackets by the formal errors alone"]
        asked = sorted((each for each in self.checks if not each.lacking), key=lambda each: _order(each.p_value))
        for check in self.checks if long else asked[:_LISTED]:
            if check.lacking:
                lines.append(f"  {check.question:{_WIDTH + 6}}{'–':>10}  not asked: {check.lacking}")
                continue
            face = f"({printed_p_value(check.at_face_value)})" if np.isfinite(check.at_face_value) else ""
            p = printed_p_value(check.p_value)
            lines.append(f"  {check.question:{_WIDTH + 6}}{p:>10} {face:>10}  {check.answer}")
        if not long:
            lacking = len(self.checks) - len(asked)
            shown = f"  the {min(_LISTED, len(asked))} of {len(asked)} checks with the smallest p-values"
            lines.append(shown + (f"; {lacking} more need columns that this table has not" if lacking else ""))
        return "\n".join(lines) + "\n"

    def tables(self) -> dict[str, Table]:
        """Sections and checks as astropy Tables, by name."""
        rows: list[Any] = [
            (section.paper.key, row.quantity, *_cells(row)) for section in self.sections for row in section.rows
        ]
        names = ("paper", "quantity", "published", "published_error", "their_way", "their_way_error",
                 "shared", "shared_error", "kind")  # fmt: skip
        verdicts = {
            "paper": [each.paper.key for each in self.sections],
            "title": [each.title for each in self.sections],
            "verdict": [(each.lacking and f"not done: {each.lacking}") or each.verdict for each in self.sections],
            "p_value": [each.p_value for each in self.sections],
        }
        asked = {
            "check": [each.key for each in self.checks],
            "question": [each.question for each in self.checks],
            "p_value": [each.p_value for each in self.checks],
            "p_at_face_value": [each.at_face_value for each in self.checks],
            "answer": [(each.lacking and f"not asked: {each.lacking}") or each.answer for each in self.checks],
        }
        return {
            "numbers": tables.table_of(dict(zip(names, zip(*rows, strict=True), strict=True)) if rows else {}),
            "verdicts": tables.table_of(verdicts),
            "checks": tables.table_of(asked),
        }

    def results(self) -> dict[str, Any]:
        """Every result behind the numbers, by the name of its file."""
        listed = {f"{each.paper.key}_{name}": result for each in self.sections for name, result in each.results.items()}
        for each in self.checks:
            listed |= {f"check_{each.key.replace(' ', '_')}_{of}": result for of, result in each.results.items()}
        return listed


def _order(p_value):
    """Sort key that puts nan last."""
    return p_value if np.isfinite(p_value) else np.inf


def _cells(row):
    kinds = {
        each.kind.replace("size", "value")
        for each in (row.published, row.theirs, row.shared)
        if np.isfinite(each.value)
    }
    pairs = [x for each in (row.published, row.theirs, row.shared) for x in (each.value, each.error)]
    return (*pairs, "/".join(sorted(kinds)))


def referee(quasars: Quasars, rng: Rng = 1, *, earlier: Field | None = None) -> Referee:
    """Ask of a catalogue whatever was published of motions of quasars, and whatever a referee would ask.

    Parameters
    ----------
    quasars : Quasars
        As `read_quasars` gives them.
    rng : Generator or int
        The source of all randomness.
    earlier : Field, optional
        Motions of the same sources in an earlier release, with the same names (source_id): is the acceleration the same
        there?

    Raises
    ------
    DegeneracyError
        If there are too few sources for a spin and an acceleration.
    """
    first, second = (int(stream.integers(2**31)) for stream in generator(rng).spawn(2))
    main = headline(quasars)
    return Referee(quasars, main, sections(quasars, main, first), checks(quasars, main, second, earlier))
