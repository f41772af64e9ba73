"""A self-contained HTML report."""

from __future__ import annotations

import base64
import io
import shlex
from collections.abc import Mapping, Sequence
from html import escape
from string import Template
from typing import Any

from fit.harmonic import HarmonicSolution
from fit.output._report import AGREE, floor_words, warnings_of, what_of
from fit.output._rows import (
    amplitude,
    cell,
    components,
    direction,
    is_scalar,
    is_scaled,
    power_rows,
    squared,
    vector_rows,
    vectors_of,
)
from vsh.plot import figure_of
from vsh.types import Table

_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<link rel="icon" href="data:,">
<style>
:root { color-scheme: light dark; --line: #d0d7de; --faint: #57606a; --back: #ffffff; --ink: #1f2328; --card: #f6f8fa; --accent: #0b5394; }
@media (prefers-color-scheme: dark) {
  :root { --line: #3d444d; --faint: #9198a1; --back: #0d1117; --ink: #e6edf3; --card: #161b22; --accent: #79b8ff; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 62rem; padding: 1.2rem; background: var(--back); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0.4rem 0; }
h2 { font-size: 1.15rem; margin: 2rem 0 0.5rem; border-bottom: 1px solid var(--line); padding-bottom: 0.2rem; }
p.lead, .faint { color: var(--faint); overflow-wrap: anywhere; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr)); gap: 0.8rem; margin: 1rem 0; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 0.8rem 1rem; }
.card b { display: block; font-size: 1.35rem; color: var(--accent); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.92rem; }
th, td { padding: 0.28rem 0.7rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
table.sortable th { cursor: pointer; user-select: none; }
table.sortable th[aria-sort=ascending]::after { content: " ▲"; font-size: 0.7em; }
table.sortable th[aria-sort=descending]::after { content: " ▼"; font-size: 0.7em; }
figure { margin: 1rem 0; }
figure img { width: 100%; height: auto; background: #ffffff; border: 1px solid var(--line); border-radius: 8px; }
figcaption { color: var(--faint); font-size: 0.9rem; }
pre { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 0.8rem; overflow-x: auto; font-size: 0.85rem; }
.warning { border-left: 4px solid #d29922; padding-left: 0.8rem; }
</style>
</head>
<body>
<h1>$title</h1>
<p class="lead">$lead</p>
$body
<script>
document.querySelectorAll("table.sortable th").forEach(function (head) {
  head.tabIndex = 0;
  function sort() {
    var table = head.closest("table"), column = head.cellIndex, rising = head.getAttribute("aria-sort") !== "ascending";
    var rows = Array.from(table.tBodies[0].rows);
    function value(row) {
      var text = row.cells[column].dataset.value || row.cells[column].textContent, number = parseFloat(text);
      return isNaN(number) || /^[a-z]/i.test(text) ? text : number;
    }
    rows.sort(function (a, b) { var x = value(a), y = value(b); return (x < y ? -1 : x > y ? 1 : 0) * (rising ? 1 : -1); });
    rows.forEach(function (row) { table.tBodies[0].appendChild(row); });
    table.querySelectorAll("th").forEach(function (other) { other.removeAttribute("aria-sort"); });
    head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  }
  head.addEventListener("click", sort);
  head.addEventListener("keydown", function (event) { if (event.key === "Enter") sort(); });
});
</script>
</body>
</html>
""")
_CAPTIONS = {
    "sky": "The sources, and the motions that were fitted to them.",
    "spectrum": "Power by degree; dotted: what noise alone gives on average.",
    "correlation": "Correlations of the coefficients.",
    "residuals": "Mean normalised residual in each part of the sky: 0 where the errors are right.",
}


def html_report(
    solution: HarmonicSolution,
    figures: dict[str, Any],
    *,
    check: Any = None,
    truth: dict[str, Any] | None = None,
    source: str = "",
    provenance: dict[str, Any] | None = None,
    command: Sequence[str] | None = None,
    title: str | None = None,
    sections: Mapping[str, Table] | None = None,
    captions: Mapping[str, str] | None = None,
) -> str:
    """A self-contained page about a solution.

    Parameters
    ----------
    solution : Solution
        What was found.
    figures : dict of str to matplotlib axes
        Embedded as PNG.
    check : CrossCheck, optional
        Both solvers at degree 1.
    truth : dict of str to Vector, optional
        Of a simulated catalogue.
    source : str
        What was fitted.
    provenance : dict, optional
        Files, counts, versions.
    command : list of str, optional
        That repeats the run.
    title : str, optional
        Of the page.
    sections : dict of str to astropy Table, optional
        Further tables by their headings.
    captions : dict of str to str, optional
        Of further figures, by name.

    Returns
    -------
    str
        HTML that asks for nothing from any network.
    """
    parts = [_cards(solution), _warnings(solution), _vectors(solution, truth or {}), _check(check), _powers(solution)]
    parts += [f"<h2>{escape(heading)}</h2>" + _section(table) for heading, table in (sections or {}).items()]
    parts += ["<h2>Figures</h2>", *(_figure(name, figure, captions or {}) for name, figure in figures.items())]
    parts += [_coefficients(solution), _notes(solution), _provenance(provenance or {}, command)]
    title = title or what_of(solution)
    lead = (
        f"{escape(source)} — {solution.n_sources} sources, degree {solution.modes.lowest} to {solution.modes.lmax} ({len(solution.modes)} coefficients), "
        f"{escape(solution.frame)} axes"
    )
    return _PAGE.substitute(title=escape(title), lead=lead, body="\n".join(filter(None, parts)))


def _cards(solution):
    cells = []
    if is_scalar(solution):
        value, error = solution.mean
        cells.append(f'<div class="card">Mean<b>{value:.4g} ± {error:.2g} {escape(solution.unit)}</b></div>')
    for name, vector in reversed(vectors_of(solution).items()):
        galactic = vector.to_frame("galactic")
        cells.append(
            f'<div class="card">{name.capitalize()}<b>{escape(amplitude(vector, 2))} {escape(solution.unit)}</b>'
            f'<span class="faint">{escape(direction(galactic))}; noise-debiased {vector.debiased_amplitude:.2f}</span></div>'
        )
    cells.append(
        f'<div class="card">χ² per degree of freedom<b>{solution.reduced_chi2:.3f}</b>'
        f'<span class="faint">{solution.chi2:.6g} / {solution.dof}; errors from {escape(solution.errors_from)}</span></div>'
    )
    return f'<div class="cards">{"".join(cells)}</div>'


def _warnings(solution):
    lines = [
        f"{label}: {text}" if label == "warning" else text
        for label, text in warnings_of(solution)
        if label != "errors from"
    ]
    return f'<p class="warning">{escape(". ".join(lines))}.</p>' if lines else ""


def _vectors(solution, truth):
    rows = [
        [f"truth of the {name}" if row.is_truth else row.name, *row.cells, row.amplitude]
        for name in vectors_of(solution)
        for row in vector_rows({name: vectors_of(solution)[name]}, truth)
    ]
    if not rows:
        return ""
    heads = [f"[{escape(solution.unit)}]", "x", "y", "z", "amplitude"]
    found = floor_words(solution)
    shared = (
        f'<p class="faint">{escape(found[0])}: {escape("; ".join(found[1:-1]))}. {escape(found[-1])}.</p>'
        if found
        else ""
    )
    return (
        f"<h2>{' and '.join(vectors_of(solution)).capitalize()}</h2>"
        + _table(heads, [[escape(cell) for cell in row] for row in rows])
        + shared
    )


def _check(check):
    if check is None:
        return ""
    lead = (
        "<h2>Cross-check</h2><p>Plain least squares of degree 1 on the same sources by two solvers without a common formula: "
        f"{'they agree' if check.largest < AGREE else 'THEY DO NOT AGREE'}; largest difference {check.largest:.1e} σ.</p>"
    )
    if check.largest < AGREE:
        return lead
    rows = [
        [f"{name}, {solver}", *components(getattr(result, name))]
        for name in ("spin", "acceleration")
        for solver, result in (("harmonics", check.harmonics), ("frame solver", check.frame))
    ]
    return lead + _table(["[µas/yr]", "x", "y", "z"], rows)


def _powers(solution):
    both = is_scaled(solution)
    rows = [
        [
            row.degree,
            row.power,
            row.debiased,
            row.error,
            escape(row.p_value),
            *([escape(row.p_value_scaled)] if both else []),
            row.z,
            row.mk_z,
        ]
        for row in power_rows(solution)
    ]
    scaled = ["p, errors scaled"] if both else []
    heads = [
        "degree",
        f"power {escape(squared(solution))}",
        "noise-debiased",
        "±",
        "p-value",
        *scaled,
        "z",
        "M&amp;K Z",
    ]
    return "<h2>Power by degree</h2><p class='faint'>Click a heading to sort.</p>" + _table(heads, rows, sortable=True)


def _coefficients(solution):
    rows = [
        [str(mode), f"{value:+.5g}", f"{error:.3g}", f"{value / error:+.2f}"]
        for mode, value, error in zip(solution.modes, solution.coefficients.values, solution.sigma, strict=True)
    ]
    table = _table(["coefficient", f"value [{escape(solution.unit)}]", "σ", "value/σ"], rows, sortable=True)
    return f"<h2>Coefficients</h2><details><summary>{len(rows)} coefficients</summary>{table}</details>"


def _notes(solution):
    if not solution.notes:
        return ""
    return "<h2>Notes</h2><ul>" + "".join(f"<li>{escape(str(note))}</li>" for note in solution.notes) + "</ul>"


def _provenance(provenance, command):
    if not provenance:
        return ""
    rows = []
    for key, value in provenance.items():
        inner = ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)
        rows.append(
            [
                escape(key.replace("_", " ")),
                f'<span style="white-space: normal; word-break: break-word">{escape(inner)}</span>',
            ]
        )
    repeat = f"<p>To repeat the run:</p><pre>{escape(shlex.join(command))}</pre>" if command else ""
    return "<h2>Where this comes from</h2>" + repeat + _table(["", ""], rows, left=True)


def _table(heads, rows, sortable=False, left=False):
    style = ' style="text-align: left"' if left else ""
    head = (
        "" if not any(heads) else "<thead><tr>" + "".join(f'<th scope="col">{h}</th>' for h in heads) + "</tr></thead>"
    )
    body = "".join("<tr>" + "".join(f"<td{style}>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    kind = ' class="sortable"' if sortable else ""
    return f'<div class="wide"><table{kind}>{head}<tbody>{body}</tbody></table></div>'


def _section(table):
    rows = [[escape(cell(each)) for each in row] for row in zip(
        *(table[name].tolist() for name in table.colnames), strict=True)]  # fmt: skip
    return _table([escape(name.replace("_", " ")) for name in table.colnames], rows, sortable=True)


def _figure(name, figure, captions):
    buffer = io.BytesIO()
    figure_of(figure).savefig(buffer, format="png", dpi=250)
    picture = base64.b64encode(buffer.getvalue()).decode()
    caption = {**_CAPTIONS, **captions}.get(name, name)
    return f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{picture}"><figcaption>{escape(caption)}</figcaption></figure>'
