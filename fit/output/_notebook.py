"""Solutions for notebooks and papers: HTML and LaTeX."""

from __future__ import annotations

import re
from html import escape
from typing import Any

import numpy as np

from fit.harmonic import HarmonicSolution
from fit.output._report import warnings_of
from fit.output._rows import direction, is_scalar, power_rows, vector_rows, vectors_of

_SYMBOLS = {
    "spin": r"$\omega$",
    "acceleration": r"$\tilde a$",
    "dipole": "dipole",
    "rotation": "rotation",
    "glide": "glide",
}


def html_of(solution: HarmonicSolution) -> str:
    """Spin, acceleration and powers as HTML tables, for a notebook."""
    rows = "".join(
        f"<tr><th>{row.name}</th>{_cells(row.cells)}<td>{escape(row.amplitude)}</td></tr>"
        for row in vector_rows(vectors_of(solution))
    )
    powers = "".join(
        f"<tr><th>{row.degree}</th>{_cells((row.power, row.debiased, row.error, row.p_value))}</tr>"
        for row in power_rows(solution)
        if row.power != "nan"  # errors of a fit that is to come
    )
    warned = [f"{label}: {said}" for label, said in warnings_of(solution) if label == "warning"]
    notes = "".join(f"<li>{escape(str(note))}</li>" for note in (*warned, *solution.notes))
    toward = "".join(
        f"<li>{name} {escape(direction(vector))}</li>"
        for name, vector in vectors_of(solution).items()
        if not np.isnan(vector.amplitude)
    )
    return (
        f"<p><b>Vector spherical harmonics</b>, degree 1 to {solution.modes.lmax}: {solution.n_sources} sources, "
        f"{escape(solution.frame)} axes, χ²/dof {solution.reduced_chi2:.3f}, errors from {escape(solution.errors_from)}</p>"
        f"<table><tr><th>[µas/yr]</th><th>x</th><th>y</th><th>z</th><th>amplitude</th></tr>{rows}</table>"
        "<table><tr><th>degree</th><th>power [(µas/yr)²]</th><th>noise-debiased</th><th>±</th><th>p-value</th></tr>"
        f"{powers}</table>" + (f"<ul>{toward}{notes}</ul>" if toward or notes else "")
    )


def _cells(cells):
    return "".join(f"<td>{escape(cell)}</td>" for cell in cells)


def latex_of(solution: Any) -> str:
    """Spin, acceleration, or mean and dipole of a scalar field, and powers as a LaTeX table (booktabs).

    Parameters
    ----------
    solution : Solution
        What was found.
    """
    unit = _tex(solution.unit).replace("µas/yr", r"\textmu as\,yr$^{-1}$").replace("µ", r"\textmu ")
    lines = [r"\begin{tabular}{lcccc}", r"\toprule"]
    if is_scalar(solution):
        value, error = solution.mean
        lines.append(rf"mean [{unit}] & ${value:.4g} \pm {error:.2g}$ & & & \\")
    lines += [r" & $x$ & $y$ & $z$ & amplitude \\", r"\midrule"]
    for row in vector_rows(vectors_of(solution)):
        cells = [f"${_tex(cell)}$" for cell in (*row.cells, row.amplitude)]
        lines.append(rf"{_SYMBOLS[row.name]} [{unit}] & " + " & ".join(cells) + r" \\")
    lines += [r"\midrule", r" & power & noise-debiased & error & $p$-value \\", r"\midrule"]
    for power in power_rows(solution):
        shown = (power.power, power.debiased, power.error, power.p_value)
        lines.append(
            rf"${power.degree[0]}_{{{power.degree[1:]}}}$ & " + " & ".join(f"${_tex(c)}$" for c in shown) + r" \\"
        )
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _tex(cell):
    """A printed number as LaTeX has it: ±, powers of ten, per cent."""
    cell = cell.replace("±", r"\pm").replace("…", r"\ldots").replace("%", r"\%").replace("<", "< ")
    return re.sub(r"(\d)e([+-]?\d+)", lambda m: rf"{m.group(1)} \times 10^{{{int(m.group(2))}}}", cell)
