"""Solutions for notebooks and papers: HTML and LaTeX."""

from html import escape

from fit.spectrum import spectrum

_SYMBOLS = {"spin": ("ω", r"\omega"), "acceleration": ("ã", r"\tilde a")}


def html_of(solution):
    """Spin, acceleration and powers as HTML tables, for a notebook."""
    rows = "".join(
        f"<tr><th>{name}</th>" + "".join(f"<td>{v:+.3f} ± {s:.3f}</td>" for v, s in zip(vector.value, vector.sigma, strict=True))
        + f"<td>{vector.amplitude:.3f} ± {vector.amplitude_error:.3f}</td></tr>"
        for name, vector in _vectors(solution)
    )  # fmt: skip
    powers = "".join(
        f"<tr><th>{d.kind}{d.l}</th><td>{d.power:.4g}</td><td>{d.debiased:.4g}</td><td>{d.error:.3g}</td><td>{d.p:.2g}</td></tr>"
        for d in spectrum(solution)
    )
    notes = "".join(f"<li>{escape(str(note))}</li>" for note in solution.notes)
    return (
        f"<p><b>Vector spherical harmonics</b>, degree 1 to {solution.modes.lmax}: {solution.n_data // 2} sources, "
        f"{escape(solution.frame)} axes, χ²/dof {solution.reduced_chi2:.3f}, errors from {escape(solution.errors_from)}</p>"
        f"<table><tr><th>[µas/yr]</th><th>x</th><th>y</th><th>z</th><th>amplitude</th></tr>{rows}</table>"
        "<table><tr><th>degree</th><th>power [(µas/yr)²]</th><th>less noise</th><th>±</th><th>chance</th></tr>"
        f"{powers}</table>" + (f"<ul>{notes}</ul>" if notes else "")
    )


def latex_of(solution):
    """Spin, acceleration and powers as a LaTeX table (booktabs)."""
    lines = [r"\begin{tabular}{lcccc}", r"\toprule", r" & $x$ & $y$ & $z$ & amplitude \\", r"\midrule"]
    for name, vector in _vectors(solution):
        symbol = _SYMBOLS[name][1]
        cells = [rf"${v:+.3f} \pm {s:.3f}$" for v, s in zip(vector.value, vector.sigma, strict=True)]
        cells.append(rf"${vector.amplitude:.3f} \pm {vector.amplitude_error:.3f}$")
        lines.append(rf"${symbol}$ [\textmu as\,yr$^{{-1}}$] & " + " & ".join(cells) + r" \\")
    lines += [r"\midrule", r" & power & less noise & error & chance \\", r"\midrule"]
    for d in spectrum(solution):
        cells = [f"{d.power:.4g}", f"{d.debiased:.4g}", f"{d.error:.3g}", f"{d.p:.2g}"]
        lines.append(rf"${d.kind}_{{{d.l}}}$ & " + " & ".join(f"${_power_of_ten(cell)}$" for cell in cells) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _power_of_ten(cell):
    mantissa, mark, exponent = cell.partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if mark else mantissa


def _vectors(solution):
    return [("spin", solution.spin), ("acceleration", solution.acceleration)]
