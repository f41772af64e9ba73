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
from vsh.types import Figure, PathName


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


def draw_figures(solution: HarmonicSolution, field: Field | ScalarField | Parts) -> dict[str, Figure]:
    """The sky, the spectrum, the correlations and the residuals: a dict of matplotlib figures.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.

    Returns
    -------
    dict[str, Figure]
    """
    from fit.output._figures import plot_correlation, plot_residuals, plot_spectrum
    from vsh.sky.plot import plot_field
    from vsh.sky.scalar_plot import plot_scalar_field

    title = f"{solution.n_sources} sources and the field fitted to degree {solution.modes.lmax}"
    seen: Any = sample_of(field) if isinstance(field, Parts) else field
    draw: Any = plot_scalar_field if isinstance(seen, ScalarField) else partial(plot_field, unit=solution.unit)
    return {
        "sky": draw(seen, solution.coefficients, title=title),
        "spectrum": plot_spectrum(solution),
        "correlation": plot_correlation(solution),
        "residuals": plot_residuals(solution, field),
    }


def write_figures(solution: HarmonicSolution, field: Field | ScalarField | Parts, folder: PathName) -> list[Path]:
    """Draw the sky, the spectrum, the correlations and the residuals as PNG; returns their paths.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        The sources.
    folder : str or Path
        Where to write.

    Returns
    -------
    list[Path]
    """
    from vsh.sky.plot import save_figures

    return save_figures(draw_figures(solution, field), folder)


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
    import matplotlib.pyplot as plt

    from fit.output._html import html_report
    from vsh.system.files import atomic_write

    figures = draw_figures(solution, field) | about.pop("further", {})
    page = html_report(solution, figures, **about)
    for figure in figures.values():
        plt.close(figure)
    with atomic_write(path) as new:
        new.write_text(page, encoding="utf-8")
