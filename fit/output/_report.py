"""A solution as a page of text."""

from html import escape
from typing import Any

import numpy as np

from fit.output._answer import answer_of
from fit.output._rows import components, direction, is_scalar, is_seen, power_rows, squared, vector_rows, vectors_of
from fit.quality import ErrorSource, printed_p_value, solution_of
from fit.spectrum import spectrum
from vsh.io.tables import two_digits
from vsh.tools.printing import printable

WIDTH = 88


def report(
    solution: Any,
    *,
    check: Any = None,
    truth: dict[str, Any] | None = None,
    source: str | None = None,
    long: bool = False,
    answer: bool = True,
) -> str:
    """The text of a solution, perhaps with a cross-check, the truth of a simulation, and what was fitted.

    With `long` it has formal errors, where the errors come from, and powers with their normal deviates; without
    `answer` it lacks the lines to quote.
    """
    solution = solution_of(solution, "report")
    lines = str(answer_of(solution)) if answer else ""
    sections = [lines] if lines else []
    sections.append(_heading(solution, source, long))
    if np.isnan(solution.coefficients.values).all():
        sections.append(_predicted(solution))
    else:
        sections += [_vectors(solution, truth or {}, long), _degrees(solution) if long else _powers(solution)]
    if check is not None and (long or not check.largest < AGREE):
        sections.append(report_check(check))
    if solution.notes:
        sections.append("Notes\n" + "\n".join(f"  - {note}" for note in solution.notes))
    return "\n\n".join(sections) + "\n"


def _heading(solution, source, long):
    modes = solution.modes
    named = f"{printable(source)}: " if source else ""
    facts = f"{solution.n_sources} sources, {solution.frame} axes, degrees {modes.lowest} to {modes.lmax}"
    if np.isfinite(solution.chi2):
        facts += f", χ²/dof = {solution.reduced_chi2:.3f}"
    lines = [f"{named}{facts}"]
    if long:
        lines.insert(0, what_of(solution))
        lines.append(f"{'coefficients':15}{len(modes)}")
        if np.isfinite(solution.chi2):
            whose = "" if solution.error_source == ErrorSource.CATALOGUE else " (by the catalogue's errors)"
            lines.append(f"{'χ²/dof':15}{solution.chi2:.6g} / {solution.dof}{whose}")
        lines.append(f"{'errors from':15}{solution.errors_from}")
    lines += [f"{label:15}{text}" for label, text in warnings_of(solution)]
    return "\n".join(lines)


def what_of(solution: Any) -> str:
    """The title of a report."""
    if is_scalar(solution):
        return f"Spherical harmonics of a scalar field{', in ' * bool(solution.unit)}{solution.unit}"
    return f"Vector spherical harmonics of {'differences of position' if solution.unit == 'µas' else 'proper motions'}"


#: A fit of fewer numbers for each coefficient is warned of.
_FEW = 4


def warnings_of(solution: Any) -> list[tuple[str, str]]:
    """What the reader of any form of a solution should know of its errors: pairs of a label and a sentence."""
    warnings = []
    warning = solution.quality.warning()
    if warning and solution.error_source == ErrorSource.CATALOGUE:
        warnings.append(("warning", f"{warning}; those below are not scaled"))
    lost = [l for l in range(solution.modes.lowest, solution.modes.lmax + 1) if solution.covariance_dof < 2 * l + 1]
    if lost:
        warnings.append(
            (
                "warning",
                (
                    f"{solution.covariance_dof + 1:.0f} replicates are too few for the 2l + 1 coefficients of degree "
                    f"{lost[0]} and above: p-values are nan there"
                ),
            )
        )
    if len(solution.modes) <= solution.dof < _FEW * len(solution.modes):
        words = f"{len(solution.modes)} coefficients of {solution.n_data} numbers: errors grow with every degree"
        warnings.append(("warning", f"{words}; a lower --lmax is enough for spin and acceleration"))
    if 0 < solution.dof < len(solution.modes):
        warnings.append(
            (
                "warning",
                (
                    f"{solution.dof} degrees of freedom for {len(solution.modes)} coefficients: χ² says little of the "
                    "errors"
                ),
            )
        )
    return warnings


def _predicted(solution):
    """What a solution says that has errors and no values yet."""
    lines = [f"{'errors [µas/yr]':16}{'x':>10}{'y':>10}{'z':>10}"]
    for name, vector in vectors_of(solution).items():
        lines.append(f"{name:16}" + "".join(f"{s:>10.3f}" for s in vector.sigma))
    lines += ["", "Power of noise by degree, ∫|V|²dΩ [(µas/yr)²]"]
    for l in range(1, solution.modes.lmax + 1):
        lines.append(f"{f'T{l}, S{l}':16}{solution.noise_power('T', l):>10.3g}{solution.noise_power('S', l):>10.3g}")
    return "\n".join(lines)


def _vectors(solution, truth, long):
    vectors = vectors_of(solution)
    rows = list(vector_rows(vectors, truth))
    lines = []
    if is_scalar(solution):
        value, error = solution.mean
        lines = [f"{'mean':14}{value:+.4g} ± {error:.2g} {solution.unit}"]
    if not rows:
        return "\n".join(lines)
    formal = vectors_of(solution.formal) if long and solution.formal is not solution else {}
    wide = max(16, *(len(cell) + 2 for row in rows for cell in row.cells))  # large values do not run together
    last = max(22, *(len(row.amplitude) + 2 for row in rows))
    lines.append(f"{f'[{solution.unit}]':14}" + "".join(f"{axis:>{wide}}" for axis in "xyz") + f"{'amplitude':>{last}}")
    for row in rows:
        label = f"  {row.name}" if row.is_truth else row.name
        lines.append(f"{label:14}" + "".join(f"{cell:>{wide}}" for cell in row.cells) + f"{row.amplitude:>{last}}")
        if not row.is_truth and row.name in formal:
            cells = (cell.partition("± ")[2] for cell in components(formal[row.name]))
            lines.append(f"{'  formal error':14}" + "".join(f"{f'± {cell}':>{wide}}" for cell in cells))
    for name, vector in vectors.items() if long else ():
        if is_seen(vector) or not vector.amplitude_error > 0:
            other = vector.to_frame("galactic" if vector.frame != "galactic" else "icrs")
            lines.append(f"{name:14}{direction(vector)}; {direction(other).removeprefix('towards ')}")
    return "\n".join(lines)


def _powers(solution):
    """The power of each degree without its noise, and its p-value: a line a degree."""
    kinds = {"T": "toroidal", "S": "spheroidal", "F": "power"}
    powers = {(each.kind, each.l): each for each in spectrum(solution)}
    shown = [kind for kind in kinds if any(kind == each for each, _ in powers)]
    unit = f" {squared(solution)}" if squared(solution) else ""
    lines = [f"Power by degree{unit} without its noise, and the p-value of as much from noise alone"]
    lines.append(f"{'degree':8}" + "".join(f"{kinds[kind]:>20}{'p':>10}" for kind in shown))
    for l in sorted({l for _, l in powers}):
        cells = [_power(powers[kind, l]) if (kind, l) in powers else f"{'':30}" for kind in shown]
        lines.append(f"{l:<8}{''.join(cells)}".rstrip())
    return "\n".join(lines)


def _power(power):
    """The power of a degree with its error and its p-value."""
    digits = two_digits(power.error)
    value = f"{power.debiased:.{digits}f} ± {power.error:.{digits}f}"
    return f"{value:>20}{printed_p_value(power.p_value):>10}"


def _degrees(solution):
    law = "exact χ², any sky" if np.isinf(solution.covariance_dof) else "Hotelling's T²: the errors are estimates"
    lines = [
        (
            f"Power by degree, ∫{'|V|' if solution.modes.components == 2 else 'f'}²dΩ {squared(solution)}: as fitted, "
            "noise-debiased, its error; the p-value of as much"
        ),
        f"from noise alone ({law}) and its normal deviate z; Mignard & Klioner's Z (uniform sky)",
        f"{'':8}{'power':>13}{'debiased':>13}{'±':>11}{'√power':>9}{'p-value':>11}{'z':>8}{'M&K Z':>8}",
    ]
    for row in power_rows(solution):
        lines.append(
            f"{row.degree:8}{row.power:>13}{row.debiased:>13}{row.error:>11}{row.root:>9}{row.p_value:>11}"
            f"{row.z:>8}{row.mk_z:>8}"
        )
    return "\n".join(lines)


def report_check(check: Any) -> str:
    """Whether two solvers agree, as text."""
    if check.largest < AGREE:
        return (
            "Cross-check: two independent least-squares solvers of degree 1, "
            f"on the same {check.frame.n_sources} sources with the\n"
            f"catalogue's errors, agree to {check.largest:.0e} σ. This tests the solvers, not the errors above."
        )
    lines = [
        (
            f"CROSS-CHECK FAILED: degree 1 on the same {check.frame.n_sources} sources by two solvers differs by "
            f"{check.largest:.1e} σ"
        ),
        f"{'[µas/yr]':26}{'x':>16}{'y':>16}{'z':>16}",
    ]
    for name in ("spin", "acceleration"):
        for solver, result in (("harmonics", check.harmonics), ("frame, QR", check.frame)):
            lines.append(f"{name:14}{solver:12}" + "".join(f"{c:>16}" for c in components(getattr(result, name))))
    return "\n".join(lines)


#: Differences of the two solvers below this are rounding. [σ]
AGREE = 1e-6


def html_of(solution: Any) -> str:
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
    warned = [f"{label}: {words}" for label, words in warnings_of(solution) if label == "warning"]
    notes = "".join(f"<li>{escape(str(note))}</li>" for note in (*warned, *solution.notes))
    answer = "".join(f"<tr><th>{label}</th><td>{escape(text)}</td></tr>" for label, text in answer_of(solution).lines)
    return (
        f"<table>{answer}</table><p><b>Vector spherical harmonics</b>, degree 1 to {solution.modes.lmax}: "
        f"{solution.n_sources} sources, "
        f"{escape(solution.frame)} axes, χ²/dof {solution.reduced_chi2:.3f}, errors from "
        f"{escape(solution.errors_from)}</p><table><tr><th>[µas/yr]</th><th>x</th><th>y</th><th>z</th>"
        f"<th>amplitude</th></tr>{rows}</table><table><tr><th>degree</th><th>power"
        f" [(µas/yr)²]</th><th>noise-debiased</th><th>±</th><th>p-value</th></tr>{powers}</table>"
        + (f"<ul>{notes}</ul>" if notes else "")
    )


def _cells(cells):
    return "".join(f"<td>{escape(cell)}</td>" for cell in cells)
