"""A self-contained page about a solution, of the panels of `vsh.figures.page`."""

from collections.abc import Mapping, Sequence
from typing import Any

from fit.results.output._files import draw_figures
from fit.results.output._text import answer_of, describe_fit_subject, warnings_of
from vsh.field import Field
from vsh.figures import page
from vsh.figures.plot import close_figures
from vsh.io.parts import Parts, sample_of
from vsh.io.sections import Answer, Section
from vsh.scalars import ScalarField
from vsh.tools.types import PathName

_FIGURE_CAPTIONS = {
    "sky": "The sources, and the field that was fitted to them: motions as dark as they are sure, grey below 2 σ.",
    "spectrum": (
        "Power by degree; arrows: 95 % limits where there is no signal; dotted: what noise alone gives on average."
    ),
    "correlation": "Correlations of degree 1 and of the coefficients of higher degrees.",
    "residuals": "Where residuals are larger (red) or smaller (blue) than their errors say, in standard deviations.",
}


def write_html(
    solution: Any,
    field: Field | ScalarField | Parts,
    path: PathName,
    *,
    beside: Mapping[str, tuple[Any, Field]] | None = None,
    figures: Mapping[str, Any] | None = None,
    further: Mapping[str, Any] | None = None,
    check: Any = None,
    truth: dict[str, Any] | None = None,
    source: str = "",
    provenance: dict[str, Any] | None = None,
    command: Sequence[str] | None = None,
    title: str | None = None,
    sections: Sequence[Section] = (),
    captions: Mapping[str, str] | None = None,
    answer: Answer | None = None,
    overwrite: bool = False,
) -> None:
    """Write a self-contained page with everything, its sky one that can be turned.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.
    path : str or Path
        The file, HTML that asks for nothing from any network.
    beside : dict of str to (Solution, Field), optional
        One other solution in the same frame with its sources, by its label: its sky stands beside.
    figures : dict of str to matplotlib axes, optional
        Those of `draw_figures` where they are drawn already; they stay open.
    further : dict of str to matplotlib axes, optional
        More figures, by name.
    check : CrossCheck, optional
        Both solvers at degree 1.
    truth : dict of str to Vector, optional
        Truth of a simulated catalogue.
    source : str
        What was fitted.
    provenance : dict, optional
        Files, counts, versions.
    command : list of str, optional
        That repeats the run.
    title : str, optional
        Title of the page.
    sections : sequence of vsh.io.sections.Section
        Further sections.
    captions : dict of str to str, optional
        Captions of further figures, by name.
    answer : Answer, optional
        The lines to quote; those of the solution unless given.
    overwrite : bool
        Whether a file that is there is replaced.
    """
    answer = answer_of(solution) if answer is None else answer
    new_figures = draw_figures(solution, field) if figures is None else {}
    shown_solutions = _collect_shown_solutions(solution, field, beside or {})
    sky_panel = page.sky(*shown_solutions) if shown_solutions else page.Panel("")
    all_figures = {**new_figures, **(figures or {}), **(further or {})}
    shown_figures = {name: axes for name, axes in all_figures.items() if not (shown_solutions and name == "sky")}
    panels = [
        page.facts_panel(answer.lines, "answer"),
        page.paragraph(_format_warnings(solution), "warning"),
        page.join_panels("The sky", sky_panel),
        *map(page.section_panel, solution.sections(long=True, check=check, truth=truth, source=source)),
        *map(page.section_panel, sections),
        page.join_panels("Figures", page.figure_row(shown_figures, {**_FIGURE_CAPTIONS, **(captions or {})})),
        _make_coefficients_panel(solution),
        page.provenance_panel(provenance or {}, command),
    ]
    modes = solution.modes
    lead = (
        f"{f'{source} — ' if source else ''}{solution.n_sources} sources, degree {modes.lowest} to {modes.lmax} "
        f"({len(modes)} coefficients), {solution.frame} axes"
    )
    close_figures(new_figures.values())
    html = page.page(title or describe_fit_subject(solution), panels, lead=lead, source=source)
    page.write_page(path, html, overwrite=overwrite)


def _format_warnings(solution):
    sentences = [f"{label}: {text}" if label == "warning" else text for label, text in warnings_of(solution)]
    return ". ".join(sentences) + "." if sentences else ""


def _make_coefficients_panel(solution):
    rows = [
        [str(mode), f"{value:+.5g}", f"{error:.3g}", f"{value / error:+.2f}"]
        for mode, value, error in zip(solution.modes, solution.coefficients.values, solution.sigma, strict=True)
    ]
    heads = ["coefficient", f"value [{solution.unit}]", "σ", "value/σ"]
    return page.join_panels("Coefficients", page.table(heads, rows, sortable=True, summary=f"{len(rows)} coefficients"))


def _collect_shown_solutions(solution, field, comparisons):
    if isinstance(field, ScalarField):
        return ()
    main_label = f"degree {solution.modes.lmax}, errors from {solution.errors_from}" if comparisons else ""
    return [
        page.ShownSolution(
            label,
            sample_of(sources) if isinstance(sources, Parts) else sources,
            shown_solution.coefficients,
            shown_solution.covariance,
            shown_solution.unit,
            shown_solution.n_sources,
        )
        for label, (shown_solution, sources) in {main_label: (solution, field), **comparisons}.items()
    ]
