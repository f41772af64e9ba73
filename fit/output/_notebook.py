"""Solutions for notebooks and papers: HTML and LaTeX."""

from __future__ import annotations

import re
from html import escape

from fit.harmonic import HarmonicSolution
from fit.output._rows import power_rows, vector_rows, vectors_of

_SYMBOLS = {"spin": r"\omega", "acceleration": r"\tilde a"}


def html_of(solution: HarmonicSolution) -> str:
    """Spin, acceleration and powers as HTML tables, for a notebook.

    Parameters
    ----------
    solution : Solution
        What was found.

    Returns
    -------
    str
    """
    rows = "".join(
        f"<tr><th>{row.name}</th>{_cells(row.cells)}<td>{escape(row.amplitude)}</td></tr>"
        for row in vector_rows(vectors_of(solution))
    )
    powers = "".join(
        f"<tr><th>{row.degree}</th>{_cells((row.power, row.debiased, row.error, row.p_value))}</tr>"
        for row in power_rows(solution)
    )
    notes = "".join(f"<li>{escape(str(note))}</li>" for note in solution.notes)
    return (
        f"<p><b>Vector spherical harmonics</b>, degree 1 to {solution.modes.lmax}: {solution.n_data // 2} sources, "
        f"{escape(solution.frame)} axes, χ²/dof {solution.reduced_chi2:.3f}, errors from {escape(solution.errors_from)}</p>"
        f"<table><tr><th>[µas/yr]</th><th>x</th><th>y</th><th>z</th><th>amplitude</th></tr>{rows}</table>"
        "<table><tr><th>degree</th><th>power [(µas/yr)²]</th><th>noise-debiased</th><th>±</th><th>p-value</th></tr>"
        f"{powers}</table>" + (f"<ul>{notes}</ul>" if notes else "")
    )


def _cells(cells):
    return "".join(f"<td>{escape(cell)}</td>" for cell in cells)


def latex_of(solution: HarmonicSolution) -> str:
    """Spin, acceleration and powers as a LaTeX table (booktabs).

    Parameters
    ----------
    solution : Solution
        What was found.

    Returns
    -------
    str
    """
    lines = [r"\begin{tabular}{lcccc}", r"\toprule", r" & $x$ & $y$ & $z$ & amplitude \\", r"\midrule"]
    for row in vector_rows(vectors_of(solution)):
        cells = [f"${_tex(cell)}$" for cell in (*row.cells, row.amplitude)]
        lines.append(rf"${_SYMBOLS[row.name]}$ [\textmu as\,yr$^{{-1}}$] & " + " & ".join(cells) + r" \\")
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
