"""A solution as a LaTeX table."""

import re
from typing import Any

import numpy as np

from fit.output._rows import amplitude, components, direction, is_scalar, p_value, vectors_of
from fit.output._verdict import with_all_errors
from fit.quality import SEEN
from fit.spectrum import spectrum
from vsh.io.tables import two_digits
from vsh.tools.arguments import choice

_SYMBOLS = {
    "spin": r"$\omega$",
    "acceleration": r"$\tilde a$",
    "dipole": "dipole",
    "rotation": "rotation",
    "glide": "glide",
}

#: How each style begins and ends, and its rules.
_STYLES = {
    "booktabs": (r"\begin{tabular}{lcccc}", r"\toprule", r"\midrule", r"\bottomrule", r"\end{tabular}"),
    "siunitx": (r"\begin{tabular}{lcccc}", r"\toprule", r"\midrule", r"\bottomrule", r"\end{tabular}"),
    "aastex": (r"\begin{deluxetable}{lcccc}", r"\startdata", r"\hline", r"\enddata", r"\end{deluxetable}"),
    "aa": (r"\begin{table}\begin{tabular}{lcccc}", r"\hline\hline", r"\hline", r"\hline", r"\end{tabular}\end{table}"),
}


def latex_of(solution: Any, style: str = "booktabs", verdict: str | None = None) -> str:
    """Spin, acceleration, or mean and dipole of a scalar field, and powers as a LaTeX table.

    Parameters
    ----------
    solution : Solution
        What was fitted.
    style : {"booktabs", "siunitx", "aastex", "aa"}
        As for `Solution.latex`.
    verdict : str, optional
        The last line; that of the solution unless given.
    """
    begin, top, rule, bottom, end = _STYLES[choice("style", style, tuple(_STYLES))]
    unit = _tex(solution.unit).replace("µas/yr", r"\textmu as\,yr$^{-1}$").replace("µ", r"\textmu ")
    lines = [begin, top]
    if is_scalar(solution):
        value, error = solution.mean
        lines.append(rf"mean [{unit}] & ${value:.4g} \pm {error:.2g}$ & & & \\")
    lines += [r" & $x$ & $y$ & $z$ & amplitude \\", rule]
    for name, vector in vectors_of(solution).items():
        digits = two_digits(vector.sigma)
        cells = [_number(cell, style) for cell in (*components(vector, digits), amplitude(vector, digits))]
        lines.append(rf"{_SYMBOLS[name]} [{unit}] & " + " & ".join(cells) + r" \\")
    lines += [rule, r" & power & noise-debiased & error & $p$-value \\", rule]
    for power in spectrum(solution):
        digits = two_digits(power.error)
        shown = (*(f"{each:.{digits}f}" for each in (power.power, power.debiased, power.error)), p_value(power.p_value))
        lines.append(rf"${power.kind}_{{{power.l}}}$ & " + " & ".join(_number(c, style) for c in shown) + r" \\")
    facts = _facts(solution, verdict)
    lines += [rule, *(rf"\multicolumn{{5}}{{p{{0.9\linewidth}}}}{{{words}}} \\" for words in facts)]
    return "\n".join([*lines, bottom, end]) + "\n"


def _facts(solution, verdict):
    """The last lines of a table: sources, degrees, χ², errors, directions, and what it comes to."""
    facts = [
        f"{solution.n_sources} sources, degrees {solution.modes.lowest} to {solution.modes.lmax}, {solution.frame} "
        f"axes, χ²/dof = {solution.reduced_chi2:.3f}, errors from {solution.errors_from}"
    ]
    for name, vector in vectors_of(solution).items():
        whole = vector
        if name in ("spin", "acceleration") and np.isfinite(solution.covariance).all():
            whole, _, _ = with_all_errors(solution, name)
        if whole.amplitude > 0 and whole.p_value < SEEN:
            other = "" if np.array_equal(whole.covariance, vector.covariance) else ", by the errors of the verdict"
            facts.append(f"{name} {direction(whole)}{other}")
    said = solution.verdict if verdict is None else verdict
    return [_words(each) for each in (*facts, *([said] if said else []))]


#: Signs of a sentence in LaTeX.
_SIGNS = {
    "%": r"\%", "_": r"\_", "&": r"\&", "χ²": r"$\chi^2$", "±": r"$\pm$", "°": r"$^\circ$", "α": r"$\alpha$",
    "δ": r"$\delta$", "µas": r"\textmu as", "…": r"\ldots ",
}  # fmt: skip


def _words(text):
    """Words as LaTeX has them."""
    for sign, tex in _SIGNS.items():
        text = text.replace(sign, tex)
    return text


def _number(cell, style):
    """A printed number, or one with its error, in a style."""
    both = re.fullmatch(r"([+-]?[\d.]+(?:e[+-]?\d+)?)(?: ± ([\d.]+))?", cell)
    if style == "siunitx" and both:
        return rf"\num{{{both[1]}{f' +- {both[2]}' if both[2] else ''}}}"
    limit = re.fullmatch(r"< +([\d.]+) \((\d+) %\)", cell)
    return rf"$<{limit[1]}$ ({limit[2]}\,\%)" if limit else f"${_tex(cell)}$"


def _tex(cell):
    """A printed number as LaTeX has it: ±, powers of ten, per cent."""
    cell = cell.replace("±", r"\pm").replace("…", r"\ldots").replace("%", r"\%").replace("<", "< ")
    return re.sub(r"(\d)e([+-]?\d+)", lambda m: rf"{m.group(1)} \times 10^{{{int(m.group(2))}}}", cell)
