"""A solution as files: report, tables with their provenance, figures."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fit.harmonic import HarmonicSolution
from vsh import tables
from vsh.field import Field
from vsh.parts import Parts, sample_of
from vsh.scalars import ScalarField
from vsh.types import PathName


def write_correlation(solution: HarmonicSolution, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write the correlation matrix as a table, a row and a column for each coefficient.

    Parameters
    ----------
    solution : Solution
        What was found.
    path : str or Path
        The file.
    meta : dict, optional
        Provenance, plain values.
    """
    names = [str(mode) for mode in solution.modes]
    columns = {"coefficient": names} | dict(zip(names, np.asarray(solution.correlation)))
    tables.write(path, columns, meta)


def draw_figures(solution: HarmonicSolution, field: Field | ScalarField | Parts) -> dict[str, Any]:
    """The sky, the spectrum, the correlations and the residuals: matplotlib axes by name.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.

    Returns
    -------
    dict of str to matplotlib axes
    """
    from fit.output._figures import plot_correlation, plot_residuals, plot_spectrum
    from vsh.plot import plot_field, plot_scalar_field

    title = f"{solution.n_sources} sources and the field fitted to degree {solution.modes.lmax}"
    seen: Any = sample_of(field) if isinstance(field, Parts) else field
    draw: Any = plot_scalar_field
    if not isinstance(seen, ScalarField):
        draw = partial(plot_field, covariance=solution.covariance, unit=solution.unit)
    return {
        "sky": draw(seen, solution.coefficients, title=title),
        "spectrum": plot_spectrum(solution),
        "correlation": plot_correlation(solution),
        "residuals": plot_residuals(solution, field),
    }


def write_figures(
    solution: HarmonicSolution, field: Field | ScalarField | Parts, folder: PathName, *, format: str = "png", dpi: float = 300
) -> list[Path]:  # fmt: skip
    """Draw the sky, the spectrum, the correlations and the residuals into files; returns their paths.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.
    folder : str or Path
        Where to write.
    format : {"png", "pdf", "svg"}
        Of the files.
    dpi : float
        Dots an inch.

    Returns
    -------
    list[Path]
    """
    from vsh.plot import save_figures

    return save_figures(draw_figures(solution, field), folder, format=format, dpi=dpi)


def write_html(solution: HarmonicSolution, field: Field | ScalarField | Parts, path: PathName, **about: Any) -> None:
    """Write a self-contained page with everything; `about` as for `fit.output.html_report`, `further` more figures by name.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.
    path : str or Path
        The file.
    **about
        What else the page says.
    """
    from fit.output._html import html_report
    from vsh.plot import close_figures
    from vsh.system.files import atomic_write

    figures = draw_figures(solution, field) | about.pop("further", {})
    page = html_report(solution, figures, **about)
    close_figures(figures.values())
    with atomic_write(path) as new:
        new.write_text(page, encoding="utf-8")
