"""A solution as a LaTeX table that can stand in a paper: one float with caption and label."""

import re
from typing import Any

from fit.output._answer import Answer, answer_of
from fit.output._rows import amplitude, components, is_scalar, p_value, vectors_of
from fit.spectrum import spectrum
from vsh.io.tables import two_digits
from vsh.tools.arguments import choice

_SYMBOLS = {"spin": r"Spin $\omega$", "acceleration": r"Acceleration $\tilde a$"}
#: Rules of each style: above, within and below; siunitx takes those of booktabs.
_RULES = {
    "booktabs": (r"\toprule", r"\midrule", r"\bottomrule"),
    "siunitx": (r"\toprule", r"\midrule", r"\bottomrule"),
    "aa": (r"\hline\hline", r"\hline", r"\hline"),
    "mnras": (r"\hline", r"\hline", r"\hline"),
    "aastex": ("", r"\hline", ""),
}
#: Signs of a sentence in LaTeX.
_SIGNS = {
    "%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "χ²": r"$\chi^2$", "±": r"$\pm$", "°": r"$^\circ$",
    "α": r"$\alpha$", "δ": r"$\delta$", "λ": r"$\lambda$", "β": r"$\beta$", "σ": r"$\sigma$", "−": "$-$",
    "µas/yr": r"$\mu$as\,yr$^{-1}$", "µas": r"$\mu$as", "…": r"\ldots ", "<": "$<$", ">": "$>$",
}  # fmt: skip
_STYLES = tuple(_RULES)


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
    above, within, below = _RULES[choice("style", style, _STYLES)]
    unit = _unit(solution.unit)
    head = r" & $x$ & $y$ & $z$ & amplitude \\"
    units = rf" & \multicolumn{{4}}{{c}}{{({unit})}} \\" if unit else ""
    body = []
    if is_scalar(solution):
        value, error = solution.mean
        body.append(rf"Mean & ${value:.4g} \pm {error:.2g}$ & & & \\")
    for name, vector in reversed(vectors_of(solution).items()):
        cells = [_number(cell, style) for cell in (*components(vector), amplitude(vector))]
        body.append(rf"{_SYMBOLS.get(name, name.capitalize())} & " + " & ".join(cells) + r" \\")
    if full:
        body += [within, *_powers(solution, style)]
    caption = _caption(solution, answer_of(solution) if answer is None else answer)
    label = r"\label{tab:vsh}"
    if style == "aastex":
        heads = " & ".join(rf"\colhead{{{each}}}" for each in ("", "$x$", "$y$", "$z$", "amplitude"))
        more = rf"\\ \colhead{{}} & \multicolumn4c{{({unit})}}" if unit else ""
        lines = [
            r"\begin{deluxetable*}{lcccc}",
            rf"\tablecaption{{{caption}{label}}}",
            rf"\tablehead{{{heads}{more}}}",
            r"\startdata",
            *body[:-1],
            body[-1].removesuffix(r" \\"),
            r"\enddata",
            r"\end{deluxetable*}",
        ]
    else:
        lines = [r"\begin{table*}", rf"\caption{{{caption}}}", label, r"\centering", r"\begin{tabular}{lcccc}"]
        lines += [above, head, units, within, *body, below, r"\end{tabular}", r"\end{table*}"]
    return "\n".join(line for line in lines if line) + "\n"


def _powers(solution, style):
    """Rows of the power of each degree, without its noise."""
    lines = [rf"Power & noise-debiased & error & $p$-value & {_squared(solution.unit)} \\"]
    for power in spectrum(solution):
        digits = two_digits(power.error)
        shown = (*(f"{each:.{digits}f}" for each in (power.debiased, power.error)), p_value(power.p_value))
        cells = " & ".join(_number(c, style) for c in shown)
        lines.append(rf"$P^{{\rm {power.kind}}}_{{{power.l}}}$ & {cells} & \\")
    return lines


def _caption(solution, answer):
    """What was fitted to what, and the answer where the vectors have one."""
    what = " and ".join(reversed(vectors_of(solution))).capitalize()
    frame = "ICRS" if solution.frame == "icrs" else solution.frame
    facts = [
        f"{what} of {solution.n_sources} sources, {frame} axes, "
        f"degrees {solution.modes.lowest} to {solution.modes.lmax}, χ²/dof = {solution.reduced_chi2:.3f}"
    ]
    facts += [f"{label.capitalize() if label.islower() else label}: {text}" for label, text in answer.lines]
    return " ".join(f"{_powers_of_ten(_words(fact))}." for fact in facts)


def _words(text):
    """Words as LaTeX has them."""
    for sign, tex in _SIGNS.items():
        text = text.replace(sign, tex)
    return text


def _powers_of_ten(text):
    return re.sub(r"(\d(?:\.\d+)?)e([+-]?\d+)", lambda m: rf"${m[1]} \times 10^{{{int(m[2])}}}$", text)


def _unit(unit):
    return _words(unit)


def _squared(unit):
    """The unit of powers."""
    return rf"(({_words(unit)})$^2$)" if unit else ""


def _number(cell, style):
    """A printed number, or one with its error, in a style."""
    both = re.fullmatch(r"([+-]?[\d.]+(?:e[+-]?\d+)?)(?: ± ([\d.]+))?", cell)
    if style == "siunitx" and both:
        return rf"\num{{{both[1]}{f' +- {both[2]}' if both[2] else ''}}}"
    limit = re.fullmatch(r"< +([\d.e+-]+) \((\d+) %\)", cell)
    return rf"$<{_tex(limit[1])}$ ({limit[2]}\,\%)" if limit else f"${_tex(cell)}$"


def _tex(cell):
    """A printed number as LaTeX has it: ±, powers of ten, per cent."""
    cell = cell.replace("±", r"\pm").replace("…", r"\ldots").replace("%", r"\%").replace("<", "< ")
    return re.sub(r"(\d)e([+-]?\d+)", lambda m: rf"{m.group(1)} \times 10^{{{int(m.group(2))}}}", cell)
