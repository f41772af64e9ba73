"""All that a referee reads of one catalogue: the headline, the published analyses, the checks."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.methods import Recommended
from fit.results.quality import SEEN
from study.referee._quasars import Quasars
from study.referee._rows import HINT, Analysis, Check
from study.referee._sections import check_all, repeat_all
from vsh.field import Field
from vsh.io import tables
from vsh.io.sections import Answer, Section, text_of
from vsh.tools.arguments import generator
from vsh.tools.digits import format_p_value
from vsh.tools.notebook import InNotebook
from vsh.tools.types import Rng, Table

#: The paper whose result is that of the lines to quote.
_QUOTED_PAPER = "klioner2021"
#: How many checks a short report lists, those with the smallest p-values.
_N_LISTED = 3


def _make_analysis_section(analysis):
    """The numbers of an analysis with the published ones."""
    title = f"{analysis.title} — {analysis.paper.reference}"
    if analysis.lacking:
        return Section(title, [("not done", analysis.lacking)])
    columns = {
        "quantity": [row.quantity for row in analysis.rows],
        "published": [str(row.published) for row in analysis.rows],
        "published method": [str(row.theirs) for row in analysis.rows],
        "systematic errors included": [str(row.shared) for row in analysis.rows],
    }
    return Section(title, [("result", analysis.verdict)], tables.table_of(columns))


@dataclass(frozen=True, eq=False, repr=False)
class Referee(InNotebook):
    """Report of a referee on a catalogue of motions of quasars.

    Attributes
    ----------
    quasars : Quasars
        The sources.
    headline : Recommended
        The acceleration with every error that is known of.
    sections : list of Analysis
        Published analyses, each repeated.
    checks : list of Check
        Whether it is the sky or the instrument.
    """

    quasars: Quasars
    headline: Recommended
    sections: list[Analysis]
    checks: list[Check]

    def __repr__(self) -> str:
        n_analyses = sum(not section.lacking for section in self.sections)
        return f"<Referee: {len(self.quasars.whole)} sources, {n_analyses} analyses, {len(self.checks)} checks>"

    @property
    def smallest(self) -> tuple[Check | None, float]:
        """The check with the smallest p-value, and that value times how many were asked (Bonferroni), 1 at most."""
        testable_checks = [check for check in self.checks if np.isfinite(check.p_value)]
        if not testable_checks:
            return None, 1.0
        worst_check = min(testable_checks, key=lambda check: check.p_value)
        return worst_check, min(1.0, worst_check.p_value * len(testable_checks))

    @property
    def answer(self) -> Answer:
        """The result to quote, that of the recommended fit, and whether a check contradicts it."""
        return Answer((*self.headline.answer.lines, ("checks", self.conclusion)))

    @property
    def conclusion(self) -> str:
        """Conclusion of all checks."""
        worst_check, p = self.smallest
        n_checks = sum(bool(np.isfinite(check.p_value)) for check in self.checks)
        if worst_check is None:
            return "no check was possible"
        corrected_text = f"p = {format_p_value(p)} after correction for {n_checks} checks"
        if p >= HINT:
            smallest_text = f"smallest p = {format_p_value(worst_check.p_value)}; {corrected_text}"
            return f"none of {n_checks} internal checks contradicts the result ({smallest_text})"
        verdict = "an instrumental effect is detected" if p < SEEN else "weak evidence of an instrumental effect"
        return f"{verdict}: it is not {worst_check.question} ({worst_check.answer}; {corrected_text})"

    def report(self, *, long: bool = False) -> str:
        """The result to quote, the verdict of each analysis, and the checks, as text.

        Parameters
        ----------
        long : bool
            Add the numbers of each analysis with the published ones, and every check.
        """
        return f"{self.answer}\n\n{text_of(self.details(long))}"

    def details(self, long: bool = True) -> tuple[Section, ...]:
        """The sections below the result to quote.

        Parameters
        ----------
        long : bool
            As for `report`.
        """
        quasars, solution = self.quasars, self.headline.solution
        floor_text = f"estimated from degrees 2 to {solution.modes.lmax}"
        floor_text = floor_text if solution.includes_floor else "not known, because so few sources determine none"
        sources_text = f"{len(quasars.whole)}; {quasars.n_clipped} outliers are excluded from the least-squares fits"
        facts = [("sources", sources_text), ("fit", f"{solution.frame} axes; systematic errors {floor_text}")]
        other_sections = [section for section in self.sections if section.paper.key != _QUOTED_PAPER]
        if not long:
            facts += [
                (section.paper.citation, f"not tested: {section.lacking}" if section.lacking else section.verdict)
                for section in other_sections
            ]
        return (
            Section(quasars.label, facts),
            *(map(_make_analysis_section, self.sections) if long else ()),
            self._make_checks_section(long),
        )

    def _make_checks_section(self, long):
        """The checks with their p-values; short, those with the smallest."""
        tests = sorted(
            (check for check in self.checks if not check.lacking),
            key=lambda check: (np.isnan(check.p_value), check.p_value),
        )
        selection = self.checks if long else tests[:_N_LISTED]
        columns = {
            "check": [check.question for check in selection],
            "p_value": [check.p_value for check in selection],
            "p_value, formal errors": [check.at_face_value for check in selection],
            "answer": [f"not tested: {check.lacking}" if check.lacking else check.answer for check in selection],
        }
        remarks = []
        if not long:
            n_untested = len(self.checks) - len(tests)
            suffix = (
                f"; besides these {len(tests)}, {n_untested} could not be made (--long lists the reasons)"
                if n_untested
                else ""
            )
            remarks = [f"Listed are the {len(selection)} of {len(tests)} checks with the smallest p-values{suffix}."]
        return Section(
            "Checks; p-values include systematic errors except in the column of formal errors",
            (),
            tables.table_of(columns),
            remarks=remarks,
        )

    def tables(self) -> dict[str, Table]:
        """Sections and checks as astropy Tables, by name."""
        rows: list[Any] = [
            (section.paper.key, row.quantity, *_number_cells(row)) for section in self.sections for row in section.rows
        ]
        names = ("paper", "quantity", "published", "published_error", "published_method", "published_method_error",
                 "systematics", "systematics_error", "kind")  # fmt: skip
        verdict_columns = {
            "paper": [entry.paper.key for entry in self.sections],
            "title": [entry.title for entry in self.sections],
            "verdict": [(entry.lacking and f"not done: {entry.lacking}") or entry.verdict for entry in self.sections],
            "p_value": [entry.p_value for entry in self.sections],
        }
        check_columns = {
            "check": [entry.key for entry in self.checks],
            "question": [entry.question for entry in self.checks],
            "p_value": [entry.p_value for entry in self.checks],
            "p_formal": [entry.at_face_value for entry in self.checks],
            "answer": [(entry.lacking and f"not tested: {entry.lacking}") or entry.answer for entry in self.checks],
        }
        return {
            "numbers": tables.table_of(dict(zip(names, zip(*rows, strict=True), strict=True)) if rows else {}),
            "verdicts": tables.table_of(verdict_columns),
            "checks": tables.table_of(check_columns),
        }

    def results(self) -> dict[str, Any]:
        """Results behind the numbers, by the name of its file."""
        results = {f"{part.paper.key}_{name}": value for part in self.sections for name, value in part.results.items()}
        for entry in self.checks:
            results |= {f"check_{entry.key.replace(' ', '_')}_{name}": result for name, result in entry.results.items()}
        return results


def _number_cells(row):
    numbers = row.published, row.theirs, row.shared
    value_types = {number.kind.replace("size", "value") for number in numbers if np.isfinite(number.value)}
    cells = [cell for number in numbers for cell in (number.value, number.error)]
    return (*cells, "/".join(sorted(value_types)))


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
    repeat_seed, check_seed = (int(stream.integers(2**31)) for stream in generator(rng).spawn(2))
    headline = quasars.recommended
    analyses = repeat_all(quasars, headline, repeat_seed)
    return Referee(quasars, headline, analyses, check_all(quasars, headline, check_seed, earlier))
