"""The referee's figures, and its page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fit.results.quality import SEEN
from study.referee._referee import Referee
from study.referee._rows import HINT, Analysis, Check, Value
from vsh.figures import page
from vsh.figures.plot import COLOURS, WIDTH, allow_many_figures, apply_style, legend_above, panels, plot_field
from vsh.io.quantities import symbol
from vsh.sky.frames import FRAMES, title_of
from vsh.tools.digits import format_p_value
from vsh.tools.types import Axes


def draw_figures(referee: Referee) -> dict[str, Any]:
    """All figures, by name."""
    solution = referee.headline.solution
    figures = {
        "accelerations": plot_accelerations(referee.sections),
        "checks": plot_checks(referee.checks),
        "sky": plot_field(referee.quasars.whole, solution.coefficients, covariance=solution.covariance),
    }
    with allow_many_figures():
        return figures | {name: result.plot() for name, result in referee.results().items()}


@apply_style
def plot_accelerations(sections: Sequence[Analysis], *, ax: Axes | None = None) -> Axes:
    """Components of g by each paper that has them: published, and ours its way; and the recommended fit, once."""
    (axes,) = panels(ax, size=(WIDTH, 2.6))
    lines: list[tuple[str, list[Value]]] = []
    recommended_lines: list[tuple[str, list[Value]]] = []
    for section in sections:
        rows = {row.quantity[:3]: row for row in section.rows if row.quantity.startswith("g_")}
        if len(rows) == 3:
            citation = section.paper.citation
            for attr, label in (("published", citation), ("theirs", f"{citation}, here")):
                lines.append((label, [getattr(rows[f"g_{axis}"], attr) for axis in "xyz"]))
            recommended_lines = [("recommended fit", [rows[f"g_{axis}"].shared for axis in "xyz"])]
    lines += recommended_lines
    y = -np.arange(len(lines))
    for k, (axis, colour) in enumerate(zip("xyz", COLOURS, strict=False)):
        values, errors = (
            np.array([getattr(components[k], attr) for _, components in lines], float) for attr in ("value", "error")
        )
        axes.errorbar(
            values, y + 0.18 * (1 - k), xerr=np.nan_to_num(errors), fmt="os^"[k], color=colour, markersize=3,
            label=symbol(f"g_{axis}"),
        )  # fmt: skip
    axes.set_yticks(y, [label for label, _ in lines])
    axes.axvline(0, color="0.7", linewidth=0.6, zorder=0)
    axes.set_xlabel("acceleration  [µas/yr]")
    legend_above(axes, 3)
    return axes


@apply_style
def plot_checks(checks: Sequence[Check], *, ax: Axes | None = None) -> Axes:
    """p-values of the checks, with systematic errors and by the formal errors alone."""
    tests = [check for check in checks if np.isfinite(check.p_value)]
    (axes,) = panels(ax, size=(WIDTH, 0.8 + 0.17 * max(len(tests), 3)))
    y = -np.arange(len(tests))
    axes.semilogx(
        [check.p_value for check in tests], y, "o", color=COLOURS[0], markersize=4, label="with systematic errors"
    )
    axes.semilogx([check.at_face_value for check in tests], y, "x", color="0.5", markersize=4, label="formal errors")
    for level, linestyle in ((SEEN, "--"), (HINT, ":")):
        axes.axvline(level, color="0.6", linestyle=linestyle, linewidth=0.7)
        position = {"xy": (level, 0), "xycoords": axes.get_xaxis_transform(), "xytext": (2, 3)}
        axes.annotate(f"{level:g}", textcoords="offset points", fontsize="x-small", color="0.4", **position)
    positive_p_values = [value for check in tests for value in (check.p_value, check.at_face_value) if value > 0]
    axes.set_xlim(max(min([1e-3, *(value / 3 for value in positive_p_values)]), 1e-12), 1.5)
    axes.set_yticks(y, [f"{title_of(check.key)} halves" if check.key in FRAMES else check.key for check in tests])
    axes.set_xlabel("p-value")
    legend_above(axes, 2)
    return axes


def make_html_page(
    referee: Referee, figures: Mapping[str, Any], *, provenance: Mapping[str, Any], command: Sequence[str] | None = None
) -> str:
    """The page: first the acceleration with systematic errors, then a section for each analysis, then the checks."""
    solution, quasars = referee.headline.solution, referee.quasars
    sky = page.ShownSolution("with systematic errors", quasars.whole, solution.coefficients, solution.covariance)
    remaining_figures = dict(figures)
    overview = {name: remaining_figures.pop(name) for name in _CAPTIONS if name in remaining_figures}
    sky_panel = page.sky(sky)
    if sky_panel.html:
        remaining_figures.pop("sky", None)
    page_panels = [
        page.facts_panel(referee.answer.lines, "answer"),
        page.join_panels("At a glance", page.figure_row(overview, _CAPTIONS)),
        page.join_panels("The sky", sky_panel),
        *(_make_analysis_panel(section, remaining_figures) for section in referee.sections),
        page.join_panels("Is it the instrument?", page.paragraph(_CHECKS_TEXT, "faint"), _make_checks_table(referee)),
        page.join_panels("Figures", page.figure_row(remaining_figures, {})),
        page.notes_panel(quasars.field.notes),
        page.provenance_panel(dict(provenance), command),
    ]
    catalogue_name = Path(quasars.label).name  # a page goes where its folders do not
    lead = f"{catalogue_name} — {len(quasars.whole)} sources, {title_of(solution.frame)} axes"
    return page.page("What the motions of these quasars say", page_panels, lead=lead)


_CAPTIONS = {
    "accelerations": "Accelerations: published, and of these sources.",
    "checks": "p-values of the checks, with systematic errors (dots) and as quoted (crosses); lines: .05 and .0027.",
}
_SECTION_CAPTIONS = {
    "classes": "Spin and acceleration of each class, with systematic errors.",
    "magnitudes": "Spin and acceleration of bright and faint sources, with systematic errors.",
    "expansion": "Size of the expansion in each bin; grey: what noise and systematic errors show on average.",
    "waves": "The energy in gravitational waves: posteriors, and 95 % limits (dashed).",
    "pairs": "Correlation of the motions of pairs by the angle between them, and the number of pairs.",
    "floor": "Power of the systematic errors in each parity: median and 68 %.",
}
_CHECKS_TEXT = (
    "Each row tests whether the acceleration and the spin depend on it: p-values with systematic errors, and with "
    "formal errors alone, which are too small where sources have systematic errors in common."
)


def _make_analysis_panel(section: Analysis, figures: dict[str, Any]) -> page.Panel:
    """Numbers of one analysis: published, with the published method, with systematic errors; and its figures."""
    about_panel = page.paragraph(f"{section.paper.reference}; {section.paper.data}", "faint")
    if section.lacking:
        return page.join_panels(section.title, about_panel, page.paragraph(f"Not done: {section.lacking}."))
    rows = [[row.quantity, *map(str, (row.published, row.theirs, row.shared))] for row in section.rows]
    column_heads = ["", "published", "ours, published method", "ours, systematic errors included"]
    figure_names = [f"{section.paper.key}_{name}" for name in section.results]
    section_figures = {name: figures.pop(name) for name in figure_names if name in figures}
    captions = {name: _SECTION_CAPTIONS.get(name.partition("_")[2], section.title) for name in section_figures}
    return page.join_panels(
        section.title, about_panel, page.paragraph(f"Verdict: {section.verdict}."), page.table(column_heads, rows),
        page.figure_row(section_figures, captions) if section_figures else page.Panel(""),
    )  # fmt: skip


def _make_checks_table(referee):
    rows = []
    for check in referee.checks:
        p_values = map(format_p_value, (check.p_value, check.at_face_value))
        rows.append([check.question, *p_values, f"not tested: {check.lacking}" if check.lacking else check.answer])
    return page.table(["check", "p, shared errors", "p, as quoted", ""], rows, sortable=True)
