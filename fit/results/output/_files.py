"""A solution as files: report, tables with their provenance, figures, and a LaTeX table with caption and label."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from fit.results.output._text import (
    answer_of,
    format_amplitude,
    format_components,
    is_of_scalar_field,
    powers_table,
    vectors_of,
    vectors_table,
)
from fit.results.spectrum import spectrum
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, sample_of
from vsh.io.sections import Answer
from vsh.scalars import ScalarField
from vsh.sky.frames import AXES, title_of
from vsh.tools.arguments import choice
from vsh.tools.digits import decimals_of_error, format_p_value, format_with_error
from vsh.tools.printing import latex_text
from vsh.tools.types import FloatArray, PathName, Table

_LATEX_VECTOR_NAMES = {"spin": r"Spin $\omega$", "acceleration": r"Acceleration $\tilde a$"}
#: Rules of each style: above, within and below; siunitx takes those of booktabs.
_TABLE_RULES = {
    "booktabs": (r"\toprule", r"\midrule", r"\bottomrule"),
    "siunitx": (r"\toprule", r"\midrule", r"\bottomrule"),
    "aa": (r"\hline\hline", r"\hline", r"\hline"),
    "mnras": (r"\hline", r"\hline", r"\hline"),
    "aastex": ("", r"\hline", ""),
}
_TABLE_STYLES = tuple(_TABLE_RULES)


def latex_of(solution: Any, style: str = "booktabs", *, full: bool = False, answer: Answer | None = None) -> str:
    """Acceleration and spin, or mean and dipole of a scalar field, as a LaTeX table.

    Parameters
    ----------
    solution : Solution
        What was fitted.
    style : {"booktabs", "siunitx", "aastex", "aa", "mnras"}
        As for `Solution.latex`.
    full : bool
        Add the power of each degree.
    answer : Answer, optional
        The lines to quote, for the caption; those of the solution unless given.
    """
    top_rule, mid_rule, bottom_rule = _TABLE_RULES[choice("style", style, _TABLE_STYLES)]
    unit = latex_text(solution.unit)
    head_row = r" & $x$ & $y$ & $z$ & amplitude \\"
    units = rf" & \multicolumn{{4}}{{c}}{{({unit})}} \\" if unit else ""
    body_rows = []
    if is_of_scalar_field(solution):
        value, error = solution.mean
        body_rows.append(rf"Mean & {_format_latex_number(format_with_error(value, error, '+'), style)} & & & \\")
    answer = answer or answer_of(solution)
    for name, vector in reversed(vectors_of(solution, answer).items()):
        cells = [_format_latex_number(cell, style) for cell in (*format_components(vector), format_amplitude(vector))]
        body_rows.append(rf"{_LATEX_VECTOR_NAMES.get(name, name.capitalize())} & " + " & ".join(cells) + r" \\")
    if full:
        body_rows += [mid_rule, *_format_latex_power_rows(solution, style)]
    caption = _format_latex_caption(solution, answer)
    label = r"\label{tab:vsh-scalar}" if is_of_scalar_field(solution) else r"\label{tab:vsh}"
    if style == "aastex":
        column_heads = " & ".join(rf"\colhead{{{column}}}" for column in ("", "$x$", "$y$", "$z$", "amplitude"))
        unit_row = rf"\\ \colhead{{}} & \multicolumn4c{{({unit})}}" if unit else ""
        lines = [
            r"\begin{deluxetable*}{lcccc}",
            rf"\tablecaption{{{caption}{label}}}",
            rf"\tablehead{{{column_heads}{unit_row}}}",
            r"\startdata",
            *body_rows[:-1],
            body_rows[-1].removesuffix(r" \\"),
            r"\enddata",
            r"\end{deluxetable*}",
        ]
    else:
        lines = [r"\begin{table*}", rf"\caption{{{caption}}}", label, r"\centering", r"\begin{tabular}{lcccc}"]
        lines += [top_rule, head_row, units, mid_rule, *body_rows, bottom_rule, r"\end{tabular}", r"\end{table*}"]
    return "\n".join(line for line in lines if line) + "\n"


def _format_latex_power_rows(solution, style):
    """Rows of the power of each degree, without its noise."""
    rows = [rf"Power & noise-debiased & error & $p$-value & {_format_latex_squared_unit(solution.unit)} \\"]
    for power in spectrum(solution):
        digits = decimals_of_error(power.error)
        texts = (*(f"{value:.{digits}f}" for value in (power.debiased, power.error)), format_p_value(power.p_value))
        cells = " & ".join(_format_latex_number(text, style) for text in texts)
        rows.append(rf"$P^{{\rm {power.kind}}}_{{{power.l}}}$ & {cells} & \\")
    return rows


def _format_latex_caption(solution, answer):
    """Caption: what was fitted to what, and the answer where the vectors have one."""
    names = ["mean"] * is_of_scalar_field(solution) + list(reversed(vectors_of(solution, answer)))
    subject = " and ".join(names).capitalize()
    sentences = [
        f"{subject} of {solution.n_sources} {'sources' if solution.unit else 'values'}, "
        f"{title_of(solution.frame)} axes, degrees {solution.modes.lowest} to {solution.modes.lmax}, "
        f"χ²/dof = {solution.reduced_chi2:.3f}"
    ]
    sentences += [f"{label.capitalize() if label.islower() else label}: {text}" for label, text in answer.lines]
    return " ".join(f"{latex_text(sentence)}." for sentence in sentences)


def _format_latex_squared_unit(unit):
    """The unit of powers."""
    return rf"(({latex_text(unit)})$^2$)" if unit else ""


def _format_latex_number(number, style):
    """A printed number, or one with its error, in a style."""
    match = re.fullmatch(r"([+-]?[\d.]+(?:e[+-]?\d+)?)(?: ± ([\d.]+))?", number)
    if style == "siunitx" and match:
        return rf"\num[separate-uncertainty, retain-explicit-plus]{{{match[1]}{f' +- {match[2]}' if match[2] else ''}}}"
    limit = re.fullmatch(r"< +([\d.e+-]+) \((\d+) %\)", number)
    return rf"$<{_format_tex(limit[1])}$ ({limit[2]}\,\%)" if limit else f"${_format_tex(number)}$"


def _format_tex(number):
    """A printed number as LaTeX has it: ±, powers of ten, per cent."""
    number = number.replace("±", r"\pm").replace("…", r"\ldots").replace("%", r"\%").replace("<", "< ")
    return re.sub(r"(\d)e([+-]?\d+)", lambda m: rf"{m.group(1)} \times 10^{{{int(m.group(2))}}}", number)


def write_correlation(solution: Any, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write the correlation matrix as a table, a row and a column for each coefficient."""
    names = [str(mode) for mode in solution.modes]
    columns = {"coefficient": names} | dict(zip(names, np.asarray(solution.correlation)))
    tables.write_columns(path, columns, meta)


#: So many sources have a row each in a folder of results; a table of more is as large as the catalogue.
_MOST_SOURCE_ROWS = 100_000


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
    residuals = solution.residuals(field)
    east, north = residuals.motion
    columns: dict[str, Any] = {} if field.name is None else {"name": np.asarray(field.name)}
    lon, lat = AXES[field.frame][:2]
    columns |= {lon: np.degrees(field.lon), lat: np.degrees(field.lat), "residual_east": east, "residual_north": north}
    columns |= {"error_east": field.sigma[0], "error_north": field.sigma[1]}
    columns |= {"weight": np.ones(len(field)) if weights is None else np.asarray(weights), "chi2": residuals.chi2}
    motion_columns = ("residual_east", "residual_north", "error_east", "error_north")
    units = dict.fromkeys(motion_columns, "uas / yr") | dict.fromkeys((lon, lat), "deg")
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
        The sources. The table of sources is not written if they are given in parts or if there are more than 100 000.
    folder : Path
        Where to.
    meta : dict, optional
        Provenance.
    weights : (n,) array, optional
        As for `sources_table`.
    """
    tables.write_table(vectors_table(solution), folder / "vectors.ecsv", meta)
    tables.write_table(powers_table(solution), folder / "powers.ecsv", meta)
    if isinstance(field, Field) and len(field) <= _MOST_SOURCE_ROWS:
        tables.write_table(sources_table(solution, field, weights), folder / "sources.ecsv", meta)
    (folder / "table.tex").write_text(latex_of(solution), encoding="utf-8")


def draw_figures(
    solution: Any, field: Field | ScalarField | Parts, weights: FloatArray | None = None, value: str | None = None
) -> dict[str, Any]:
    """The sky, the spectrum, the correlations and the residuals: matplotlib axes by name.

    `weights` are those of a robust fit, and `value` is how a number and its error are called.
    """
    from fit.results.output._figures import plot_correlation, plot_residuals, plot_sky, plot_spectrum

    return {
        "sky": plot_sky(solution, sample_of(field) if isinstance(field, Parts) else field, value=value),
        "spectrum": plot_spectrum(solution),
        "correlation": plot_correlation(solution),
        "residuals": plot_residuals(solution, field, weights=weights if isinstance(field, Field) else None),
    }
