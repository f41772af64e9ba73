"""A solution as a page of text."""

from html import escape
from typing import Any

import numpy as np

from fit.output._rows import (
    components,
    direction,
    is_scalar,
    is_scaled,
    is_seen,
    power_rows,
    squared,
    vector_rows,
    vectors_of,
)
from fit.quality import ErrorSource, solution_of
from vsh.tools.printing import printable

WIDTH = 88


def report(solution: Any, *, check: Any = None, truth: dict[str, Any] | None = None, source: str | None = None) -> str:
    """The text of a solution, perhaps with a cross-check, the truth of a simulation, and what was fitted."""
    solution = solution_of(solution, "report")
    sections = [_heading(solution, source)]
    if np.isnan(solution.coefficients.values).all():
        sections.append(_predicted(solution))
    else:
        sections += [_vectors(solution, truth or {}), *_floor(solution), _degrees(solution)]
    if check is not None:
        sections.append(report_check(check))
    if solution.notes:
        sections.append("Notes\n" + "\n".join(f"  - {note}" for note in solution.notes))
    return "\n\n".join(sections) + "\n"


def _heading(solution, source):
    modes = solution.modes
    lines = [what_of(solution), "─" * WIDTH]
    if source:
        lines.append(f"catalogue      {printable(source)}")
    lines += [
        f"sources        {solution.n_sources}",
        f"frame          {solution.frame}",
        f"degree         {modes.lowest} to {modes.lmax}: {len(modes)} coefficients",
    ]
    if np.isfinite(solution.chi2):
        whose = "" if solution.error_source == ErrorSource.CATALOGUE else " (by the catalogue's errors)"
        lines.append(f"χ²/dof         {solution.chi2:.6g} / {solution.dof} = {solution.reduced_chi2:.3f}{whose}")
    lines += [f"{label:15}{text}" for label, text in warnings_of(solution)]
    return "\n".join(lines)


def what_of(solution: Any) -> str:
    """The title of a report."""
    if is_scalar(solution):
        return f"Spherical harmonics of a scalar field{', in ' * bool(solution.unit)}{solution.unit}"
    return f"Vector spherical harmonics of {'differences of position' if solution.unit == 'µas' else 'proper motions'}"


#: Where residuals are larger than errors.
NEXT_STEP = (
    "next: --robust student (fit.robust.student_t) gives less weight to sources that scatter more than their errors "
    "say, and takes its errors from the residuals"
)


#: A fit of fewer numbers for each coefficient is warned of.
_FEW = 4


def warnings_of(solution: Any) -> list[tuple[str, str]]:
    """What the reader of any form of a solution should know of its errors: pairs of a label and a sentence."""
    warnings = []
    if solution.error_source != ErrorSource.CATALOGUE:
        warnings.append(("errors from", solution.errors_from))
    warning = solution.quality.warning()
    if warning and solution.error_source == ErrorSource.CATALOGUE:
        warnings.append(("warning", warning))
        if solution.quality.factor > 1:
            warnings.append(("", "the errors below are not scaled by that; p-values are given for both"))
            warnings.append(("", NEXT_STEP))
    elif warning and solution.quality.factor > 1:
        warnings.append(("", f"{warning}; those below do not rest on the catalogue's"))
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


def _vectors(solution, truth):
    rows = list(vector_rows(vectors_of(solution), truth))
    lines = []
    if is_scalar(solution):
        value, error = solution.mean
        lines = [f"{'mean':14}{value:+.4g} ± {error:.2g} {solution.unit}"]
    if not rows:
        return "\n".join(lines)
    wide = max(16, *(len(cell) + 2 for row in rows for cell in row.cells))  # large values do not run together
    last = max(22, *(len(row.amplitude) + 2 for row in rows))
    lines.append(f"{f'[{solution.unit}]':14}" + "".join(f"{axis:>{wide}}" for axis in "xyz") + f"{'amplitude':>{last}}")
    for row in rows:
        label = f"  {row.name}" if row.is_truth else row.name
        lines.append(f"{label:14}" + "".join(f"{cell:>{wide}}" for cell in row.cells) + f"{row.amplitude:>{last}}")
    lines.append("")
    for name, vector in vectors_of(solution).items():
        other = vector.to_frame("galactic" if vector.frame != "galactic" else "icrs")
        lines.append(f"{name:14}{direction(vector)}")
        debiased = f"; noise-debiased amplitude {vector.debiased_amplitude:.3f}" if is_seen(vector) else ""
        lines.append(f"{'':14}{direction(other)}{debiased}")
    return "\n".join(lines)


def _floor(solution):
    lines = floor_lines(solution)
    if not lines and solution.modes.lmax >= 3 and solution.unit == "µas/yr" and not solution.by_prior:
        return [
            "Errors that sources share were not estimated, and are not in the errors above: fit.background.add_floor"
        ]
    return [lines[0] + ":\n  " + "\n  ".join(lines[1:])] if lines else []


def floor_lines(solution: Any) -> tuple[str, ...]:
    """The floor that was estimated beside a solution: a heading, then lines; none where it has none."""
    floor = solution.floor
    if floor is None:
        return ()
    degrees = f"{floor.degrees[0]} to {floor.degrees[-1]}"
    lines = [f"Errors that sources share, from the power of degrees {degrees}; not in the errors above"]
    for name, error, (low, high) in (
        ("spin", floor.spin_error, floor.spin_interval),
        ("acceleration", floor.acceleration_error, floor.acceleration_interval),
    ):
        lines.append(f"{name:14}± {error:.3f} µas/yr in each component ({low:.3f} … {high:.3f}, 68 %)")
    return (*lines, "--floor, or fit.solve(normal, floor=fit.background.floor(normal)) in Python, includes them")


def _degrees(solution):
    both = is_scaled(solution)
    law = "exact χ², any sky" if np.isinf(solution.covariance_dof) else "Hotelling's T²: the errors are estimates"
    lines = [
        (
            f"Power by degree, ∫{'|V|' if solution.modes.components == 2 else 'f'}²dΩ {squared(solution)}: as fitted, "
            "noise-debiased, its error; the p-value of as much"
        ),
        f"from noise alone ({law}) and its normal deviate z; Mignard & Klioner's Z (uniform sky)",
        *(["p scaled: with errors multiplied by √(χ²/dof)"] if both else []),
        f"{'':8}{'power':>13}{'debiased':>13}{'±':>11}{'√power':>9}{'p-value':>11}"
        + (f"{'p scaled':>11}" if both else "")
        + f"{'z':>8}{'M&K Z':>8}",
    ]
    for row in power_rows(solution):
        lines.append(
            f"{row.degree:8}{row.power:>13}{row.debiased:>13}{row.error:>11}{row.root:>9}{row.p_value:>11}"
            + (f"{row.p_value_scaled:>11}" if both else "")
            + f"{row.z:>8}{row.mk_z:>8}"
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
    toward = "".join(
        f"<li>{name} {escape(direction(vector))}</li>"
        for name, vector in vectors_of(solution).items()
        if not np.isnan(vector.amplitude)
    )
    return (
        f"<p><b>Vector spherical harmonics</b>, degree 1 to {solution.modes.lmax}: {solution.n_sources} sources, "
        f"{escape(solution.frame)} axes, χ²/dof {solution.reduced_chi2:.3f}, errors from "
        f"{escape(solution.errors_from)}</p><table><tr><th>[µas/yr]</th><th>x</th><th>y</th><th>z</th><th>amplitude</th></tr>{rows}</table><table><tr><th>degree</th><th>power"
        f" [(µas/yr)²]</th><th>noise-debiased</th><th>±</th><th>p-value</th></tr>{powers}</table>"
        + (f"<ul>{toward}{notes}</ul>" if toward or notes else "")
    )


def _cells(cells):
    return "".join(f"<td>{escape(cell)}</td>" for cell in cells)
