"""A solution as files: report, tables with their provenance, figures."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fit.output._latex import latex_of
from fit.output._rows import powers_table, vectors_table
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, sample_of
from vsh.scalars import ScalarField
from vsh.tools.arguments import explained
from vsh.tools.types import FloatArray, PathName, Table


def write_correlation(solution: Any, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write the correlation matrix as a table, a row and a column for each coefficient."""
    names = [str(mode) for mode in solution.modes]
    columns = {"coefficient": names} | dict(zip(names, np.asarray(solution.correlation)))
    tables.write(path, columns, meta)


#: So many sources have a row each in a folder of results; a table of more is as large as the catalogue.
_MOST_ROWS = 100_000


def sources_table(solution: Any, field: Field, weights: FloatArray | None = None) -> Table:
    """The sources as an astropy Table, a row each: place, motion less the fit, errors, weight, χ² of two components.

    Parameters
    ----------
    solution : Solution
        What was fitted.
    field : Field
        The sources, in the frame of the solution.
    weights : (n,) array, optional
        Factor on each source's inverse covariance in the fit; 1 unless given.
    """
    left = solution.residuals(field)
    east, north = left.motion
    columns: dict[str, Any] = {} if field.name is None else {"name": np.asarray(field.name)}
    lon, lat = ("ra", "dec") if field.frame == "icrs" else ("lon", "lat")
    columns |= {lon: np.degrees(field.lon), lat: np.degrees(field.lat), "residual_east": east, "residual_north": north}
    columns |= {"error_east": field.sigma[0], "error_north": field.sigma[1]}
    columns |= {"weight": np.ones(len(field)) if weights is None else np.asarray(weights), "chi2": left.chi2}
    motions = ("residual_east", "residual_north", "error_east", "error_north")
    units = dict.fromkeys(motions, "uas / yr") | dict.fromkeys((lon, lat), "deg")
    return tables.table_of(columns, {"frame": field.frame}, units)


def write_tables(
    solution: Any,
    field: Field | Parts,
    folder: Path,
    meta: dict[str, Any] | None = None,
    weights: FloatArray | None = None,
) -> None:
    """Write vectors, powers and sources as tables, and a LaTeX table.

    Parameters
    ----------
    solution : Solution
        What was fitted.
    field : Field or Parts
        The sources; in parts, or more than 100 000, they have no rows.
    folder : Path
        Where to.
    meta : dict, optional
        Provenance.
    weights : (n,) array, optional
        As for `sources_table`.
    """
    tables.write_table(vectors_table(solution), folder / "vectors.ecsv", meta)
    tables.write_table(powers_table(solution), folder / "powers.ecsv", meta)
    if isinstance(field, Field) and len(field) <= _MOST_ROWS:
        tables.write_table(sources_table(solution, field, weights), folder / "sources.ecsv", meta)
    (folder / "table.tex").write_text(latex_of(solution), encoding="utf-8")


def draw_figures(
    solution: Any, field: Field | ScalarField | Parts, weights: FloatArray | None = None
) -> dict[str, Any]:
    """The sky, the spectrum, the correlations and the residuals: matplotlib axes by name; `weights` of a robust fit."""
    from fit.output._figures import plot_correlation, plot_residuals, plot_spectrum
    from vsh.figures.plot import plot_field, plot_scalar_field

    title = f"{solution.n_sources} sources and the field fitted to degree {solution.modes.lmax}"
    seen: Any = sample_of(field) if isinstance(field, Parts) else field
    draw: Any = plot_scalar_field
    if not isinstance(seen, ScalarField):
        draw = partial(plot_field, covariance=solution.covariance, unit=solution.unit)
    return {
        "sky": draw(seen, solution.coefficients, title=title),
        "spectrum": plot_spectrum(solution),
        "correlation": plot_correlation(solution),
        "residuals": plot_residuals(solution, field, weights=weights if isinstance(field, Field) else None),
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
            each.covariance,
            each.unit,
            each.n_sources,
        )
        for label, (each, sources) in {own: (solution, field), **beside}.items()
    ]
