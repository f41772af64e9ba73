"""The referee's figures, and its page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fit.results.quality import SEEN
from study.referee._referee import Referee
from study.referee._rows import HINT, Analysis, Check, Value
from vsh.figures import page
from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, many_figures, panels, plot_field
from vsh.io.tables import printed_p_value
from vsh.tools.types import Axes


def draw(referee: Referee) -> dict[str, Any]:
    """All figures, by name."""
    field, solution = referee.quasars.field, referee.headline.solution
    drawn = {
        "accelerations": plot_accelerations(referee.sections),
        "checks": plot_checks(referee.checks),
        "sky": plot_field(field, solution.coefficients, covariance=solution.covariance),
    }
    with many_figures():
        return drawn | {name: result.plot() for name, result in referee.results().items()}


@apply_style
def plot_accelerations(sections: Sequence[Analysis], *, ax: Axes | None = None) -> Axes:
    """Components of g by each paper that has them: published, and ours its way; and the recommended fit, once."""
    (axes,) = panels(ax, size=(WIDTH, 2.6))
    lines: list[tuple[str, list[Value]]] = []
    recommended: list[tuple[str, list[Value]]] = []
    for section in sections:
        rows = {row.quantity[:3]: row for row in section.rows if row.quantity.startswith("g_")}
        if len(rows) == 3:
            for of, words in (("published", section.paper.short), ("theirs", "here, published method")):
                lines.append((words, [getattr(rows[f"g_{axis}"], of) for axis in "xyz"]))
            recommended = [("here, recommended fit", [rows[f"g_{axis}"].shared for axis in "xyz"])]
    lines += recommended
    y = -np.arange(len(lines))
    for k, (axis, colour) in enumerate(zip("xyz", COLOURS, strict=False)):
        values, errors = (np.array([getattr(each[k], of) for _, each in lines], float) for of in ("value", "error"))
        axes.errorbar(
            values, y + 0.18 * (1 - k), xerr=np.nan_to_num(errors), fmt="os^"[k], color=colour, markersize=3,
            label=f"$g_{axis}$",
        )  # fmt: skip
    axes.set_yticks(y, [words for words, _ in lines])
    axes.axvline(0, color="0.7", linewidth=0.6, zorder=0)
    axes.set_xlabel("acceleration  [µas/yr]")
    legend_above(axes, 3)
    return axes


@apply_style
def plot_checks(checks: Sequence[Check], *, ax: Axes | None = None) -> Axes:
    """p-values of the checks, with systematic errors and by the formal errors alone."""
    asked = [each for each in checks if np.isfinite(each.p_value)]
    (axes,) = panels(ax, size=(WIDTH, 0.8 + 0.17 * max(len(asked), 3)))
    y = -np.arange(len(asked))
    axes.semilogx(
        [each.p_value for each in asked], y, "o", color=COLOURS[0], markersize=4, label="with systematic errors"
    )
    axes.semilogx([each.at_face_value for each in asked], y, "x", color="0.5", markersize=4, label="formal errors")
    axes.axvline(SEEN, color="0.5", linestyle="--", linewidth=0.7)
    axes.axvline(HINT, color="0.7", linestyle=":", linewidth=0.7)
    for level in (SEEN, HINT):
        place = {"xy": (level, 0), "xycoords": axes.get_xaxis_transform(), "xytext": (2, 3)}
        axes.annotate(f"{level:g}", textcoords="offset points", fontsize="x-small", color="0.4", **place)
    lowest = [value for each in asked for value in (each.p_value, each.at_face_value) if value > 0]
    axes.set_xlim(max(min([1e-3, *(value / 3 for value in lowest)]), 1e-12), 1.5)
    axes.set_yticks(y, [each.key for each in asked])
    axes.set_xlabel("p-value")
    legend_above(axes, 2)
    return axes


def html(
    referee: Referee, figures: Mapping[str, Any], *, provenance: Mapping[str, Any], command: Sequence[str] | None = None
) -> str:
    """The page: first the acceleration with systematic errors, then a section for each analysis, then the checks."""
    solution, quasars = referee.headline.solution, referee.quasars
    shown = page.ShownPage("with systematic errors", quasars.field, solution.coefficients, solution.covariance)
    drawn = dict(figures)
    overview = {name: drawn.pop(name) for name in _CAPTIONS if name in drawn}
    turned = page.sky(shown)
    if turned.html:
        drawn.pop("sky", None)
    panels_ = [
        page.answer(referee.answer.lines),
        page.heading("At a glance", page.figures(overview, _CAPTIONS)),
        page.heading("The sky", turned),
        *(_section(section, drawn) for section in referee.sections),
        page.heading("Is it the instrument?", page.words(_CHECKS, "faint"), _checks(referee)),
        page.heading("Figures", page.figures(drawn, {})),
        page.notes(quasars.field.notes),
        page.provenance(dict(provenance), command),
    ]
    name = Path(quasars.label).name  # a page goes where its folders do not
    lead = f"{name} — {len(quasars.whole)} sources, {solution.frame.replace('icrs', 'ICRS')} axes"
    return page.page("What the motions of these quasars say", panels_, lead=lead)


_CAPTIONS = {
    "accelerations": "Accelerations: published, and of these sources.",
    "checks": "p-values of the checks, with systematic errors (dots) and as quoted (crosses); lines: .05 and .0027.",
}
_CHECKS = (
    "Each row: the acceleration and the spin do not depend on it. p-values with the systematic errors; beside "
    "them those with formal errors alone, which cry wolf where errors are shared."
)


def _section(section: Analysis, drawn: dict[str, Any]) -> page.Panel:
    """Published, ours their way, ours with shared errors; the figures behind it."""
    about = page.words(f"{section.paper.reference}; {section.paper.data}", "faint")
    if section.lacking:
        return page.heading(section.title, about, page.words(f"Not done: {section.lacking}."))
    rows = [[row.quantity, *map(str, (row.published, row.theirs, row.shared))] for row in section.rows]
    heads = ["", "published", "ours, published method", "ours, systematic errors included"]
    names = [f"{section.paper.key}_{name}" for name in section.results]
    own = {name: drawn.pop(name) for name in names if name in drawn}
    captions = {name: name.partition("_")[2].replace("_", " ") for name in own}
    return page.heading(
        section.title, about, page.words(f"Verdict: {section.verdict}."), page.table(heads, rows),
        page.figures(own, captions) if own else page.Panel(""),
    )  # fmt: skip


def _checks(referee):
    rows = [
        [
            each.question,
            printed_p_value(each.p_value) if np.isfinite(each.p_value) else "–",
            printed_p_value(each.at_face_value) if np.isfinite(each.at_face_value) else "–",
            f"not tested: {each.lacking}" if each.lacking else each.answer,
        ]
        for each in referee.checks
    ]
    return page.table(["check", "p, shared errors", "p, as quoted", ""], rows, sortable=True)
