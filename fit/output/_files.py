"""A solution as files: report, tables with their provenance, figures."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fit.output._verdict import covariance_of_all
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, sample_of
from vsh.scalars import ScalarField
from vsh.tools.arguments import explained
from vsh.tools.types import PathName


def write_correlation(solution: Any, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write the correlation matrix as a table, a row and a column for each coefficient."""
    names = [str(mode) for mode in solution.modes]
    columns = {"coefficient": names} | dict(zip(names, np.asarray(solution.correlation)))
    tables.write(path, columns, meta)


def draw_figures(solution: Any, field: Field | ScalarField | Parts) -> dict[str, Any]:
    """The sky, the spectrum, the correlations and the residuals: matplotlib axes by name."""
    from fit.output._figures import plot_correlation, plot_residuals, plot_spectrum
    from vsh.figures.plot import plot_field, plot_scalar_field

    title = f"{solution.n_sources} sources and the field fitted to degree {solution.modes.lmax}"
    seen: Any = sample_of(field) if isinstance(field, Parts) else field
    draw: Any = plot_scalar_field
    if not isinstance(seen, ScalarField):
        draw = partial(plot_field, covariance=covariance_of_all(solution), unit=solution.unit)
    return {
        "sky": draw(seen, solution.coefficients, title=title),
        "spectrum": plot_spectrum(solution),
        "correlation": plot_correlation(solution),
        "residuals": plot_residuals(solution, field),
    }


def write_figures(
    solution: Any, field: Field | ScalarField | Parts, folder: PathName, *, format: str = "png", dpi: float = 300
) -> list[Path]:
    """Draw the sky, the spectrum, the correlations and the residuals into files; returns their paths."""
    from vsh.figures.plot import save_figures

    return save_figures(draw_figures(solution, field), folder, format=format, dpi=dpi)


@explained
def write_html(
    solution: Any,
    field: Field | ScalarField | Parts,
    path: PathName,
    *,
    beside: Mapping[str, tuple[Any, Field]] | None = None,
    figures: Mapping[str, Any] | None = None,
    further: Mapping[str, Any] | None = None,
    **about: Any,
) -> None:
    """Write a self-contained page with everything, its sky one that can be turned.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.
    path : str or Path
        The file.
    beside : dict of str to (Solution, Field), optional
        One other solution in the same frame with its sources, by its label: its sky stands beside.
    figures : dict of str to matplotlib axes, optional
        Those of `draw_figures` where they are drawn already; they stay open.
    further : dict of str to matplotlib axes, optional
        More figures, by name.
    **about
        What else the page says, as for `fit.output.html_report`.
    """
    from fit.output._html import html_report
    from vsh.figures.page import write_page
    from vsh.figures.plot import close_figures

    own = draw_figures(solution, field) if figures is None else {}
    page = html_report(
        solution, {**own, **(figures or {}), **(further or {})}, skies=_skies(solution, field, beside or {}), **about
    )
    close_figures(own.values())
    write_page(path, page)


def _skies(solution, field, beside):
    from vsh.figures.page import Shown

    if isinstance(field, ScalarField):
        return ()
    own = f"degree {solution.modes.lmax}, errors from {solution.errors_from}" if beside else ""
    return [
        Shown(
            label,
            sample_of(sources) if isinstance(sources, Parts) else sources,
            each.coefficients,
            covariance_of_all(each),
            each.unit,
            each.n_sources,
        )
        for label, (each, sources) in {own: (solution, field), **beside}.items()
    ]
