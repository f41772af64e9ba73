"""A solution as text: the four lines to quote, the rows of vectors and powers, the report, and a summary in a table.

Text, page, notebook, LaTeX and JSON take their rows from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from fit.results.quality import (
    CLIPPED,
    ERRORS_TOO_SMALL,
    ONE_SIDE,
    REPEATED,
    SEEN,
    TOO_LITTLE_SCATTER,
    WRONG_UNIT_FACTOR,
    ErrorSource,
    hint_of,
    solution_of,
)
from fit.results.spectrum import spectrum
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.length import FEWEST_DOF
from vsh.sky.frames import ANGLES
from vsh.tools.digits import decimals_of_error, format_p_value, format_three_digits, format_values, format_with_error
from vsh.tools.notes import ASSUMED_UNITS, codes_of, doubts_of, has_code
from vsh.tools.printing import printable
from vsh.tools.types import FloatArray, Table
from vsh.vector import GAIA_EDR3, Vector


def vector_rows(
    vectors: Mapping[str, Vector], truth: Mapping[str, Vector] | None = None, formal: Mapping[str, Vector] | None = None
) -> list[tuple[str, ...]]:
    """Rows of the table of vectors, formal errors and the truth of a simulation below each."""
    rows = []
    for name, vector in vectors.items():
        rows.append((name, *format_components(vector), format_amplitude(vector)))
        if formal:
            errors = (cell.partition("± ")[2] for cell in format_components(formal[name]))
            rows.append(("  formal error", *(f"± {error}" for error in errors), ""))
        if (true_vector := (truth or {}).get(name)) is not None:
            true_vector, n_decimals = true_vector.to_frame(vector.frame), decimals_of_error(vector.sigma)
            components_and_pulls = zip(true_vector.value, pulls(vector, true_vector), strict=True)
            texts = (f"{component:+.{n_decimals}f} ({pull:+.1f}σ)" for component, pull in components_and_pulls)
            rows.append(("  truth", *texts, f"{true_vector.amplitude:.{n_decimals}f}"))
    return rows


def vectors_of(solution: Any, answer: Answer | None = None) -> dict[str, Vector]:
    """Spin and acceleration by name; rotation and glide of positions or as the answer says; a scalar field's dipole."""
    if is_of_scalar_field(solution):
        return {"dipole": solution.dipole} if solution.modes.lmax > 0 else {}
    is_rotation = solution.unit == "µas" or (answer is not None and "rotation" in dict(answer.lines))
    names = ("rotation", "glide") if is_rotation else ("spin", "acceleration")
    return dict(zip(names, (solution.spin, solution.acceleration), strict=True))


def is_of_scalar_field(solution: Any) -> bool:
    """Return whether it is of a scalar field, which has a mean and a dipole in place of spin and acceleration."""
    return solution.modes.components == 1


def format_squared_unit(solution: Any) -> str:
    """The unit of powers, in brackets; nothing of pure numbers."""
    return f"[({solution.unit})²]" if solution.unit else ""


def pulls(vector: Vector, true: Vector) -> FloatArray:
    """Deviation of a fit from the truth in its own errors, (3,): positive where the fit is larger."""
    return (vector.value - true.to_frame(vector.frame).value) / vector.sigma


def format_components(vector: Vector) -> tuple[str, ...]:
    """Three components with their errors, of which the smallest has two digits."""
    return format_values(vector.value, vector.sigma)


def format_amplitude(vector: Vector) -> str:
    """Length with its error where the vector is detected, otherwise its upper limit."""
    if np.isnan(vector.amplitude):  # errors of a fit that is to come
        return ""
    if not vector.amplitude_error > 0:
        return f"{vector.amplitude:.3f}"
    if is_seen(vector):
        return format_with_error(vector.amplitude, vector.amplitude_error)
    return f"< {format_three_digits(vector.amplitude_limit(0.95))} (95 %)"


#: A vector of fewer errors along itself has no size and no direction to quote, however unlikely zero is.
_LEAST_AMPLITUDE_IN_ERRORS = 2.0


def is_seen(vector: Vector) -> bool:
    """Return whether a vector is detected: whether there is an amplitude and a direction to speak of."""
    return bool(vector.p_value < SEEN and vector.amplitude >= _LEAST_AMPLITUDE_IN_ERRORS * vector.amplitude_error)


def format_direction_with_cone(vector: Vector) -> str:
    """Direction of a vector with its cone of 68 %: "α = 269°, δ = −28° (± 7°)"."""
    names = ANGLES[vector.frame]
    coordinates = ", ".join(f"{name} = {value:.0f}°" for name, value in zip(names, vector.direction, strict=True))
    return f"{coordinates} (± {vector.direction_cone():.0f}°)"


def format_direction(vector: Vector) -> str:
    """Direction of a vector, named after the frame: with errors, or with a cone where they are large."""
    names = ANGLES[vector.frame]
    errors = vector.direction_error
    if not vector.amplitude_error > 0 or (is_seen(vector) and max(errors) <= 40):
        pairs = zip(names, vector.direction, errors, strict=True)
        return "towards " + ", ".join(f"{name} = {value:.1f} ± {error:.1f}°" for name, value, error in pairs)
    return f"towards {format_direction_with_cone(vector)}" if is_seen(vector) else "direction not determined"


def power_rows(solution: Any) -> list[tuple[str, ...]]:
    """Rows of the table of powers: degree, power, debiased, error, root, p-value, z and the z of Mignard & Klioner."""
    return [
        (
            f"{degree.kind}{degree.l}",
            f"{degree.power:.5g}",
            f"{degree.debiased:.5g}",
            f"{degree.error:.3g}",
            f"{np.sqrt(degree.power):.3g}",
            format_p_value(degree.p_value),
            f"{degree.z:.2f}",
            f"{degree.mk_z:.2f}",
        )
        for degree in spectrum(solution)
    ]


def cell(value: Any) -> str:
    """A number of a table for reading: four digits, none behind the point from a thousand on, nothing for nan."""
    if not isinstance(value, float):
        return str(value)
    return "" if value != value else f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"


def vectors_table(solution: Any) -> Table:
    """Spin and acceleration (rotation and glide; a dipole, with the mean in `meta`) as an astropy Table, a row each.

    Errors are those of the result; formal ones, N⁻¹ by the weights of the fit, stand beside them. lon and lat are nan
    where the vector is not detected; fitted_lon and fitted_lat are there always.
    """
    vectors, formal = vectors_of(solution), vectors_of(solution.formal)
    lengths = ("amplitude", "amplitude_error", "debiased_amplitude", "low_68", "high_68", "limit_95")
    angle_columns = ("lon", "lat", "lon_error", "lat_error", "fitted_lon", "fitted_lat")
    rows = [
        (
            *v.value,
            *v.sigma,
            *formal[name].sigma,
            *v.covariance[np.triu_indices(3, 1)],
            v.amplitude,
            v.amplitude_error,
            v.debiased_amplitude if is_seen(v) else np.nan,
            *v.amplitude_interval(0.68),
            v.amplitude_limit(0.95),
            *((*v.direction, *v.direction_error) if is_seen(v) else (np.nan,) * 4),
            *v.direction,
            v.p_value,
        )
        for name, v in vectors.items()
    ]
    axes = ("x", "y", "z")
    components = (*axes, *(f"sigma_{axis}" for axis in axes), *(f"formal_sigma_{axis}" for axis in axes))
    products = ("cov_xy", "cov_xz", "cov_yz")
    column_names = (*components, *products, *lengths, *angle_columns, "p_value")
    values = np.array(rows, float).reshape(-1, len(column_names)).T
    units = dict.fromkeys((*components, *lengths), solution.unit) | dict.fromkeys(products, square_of(solution.unit))
    units |= dict.fromkeys(angle_columns, "deg")
    meta = {
        "frame": solution.frame,
        "lmax": solution.modes.lmax,
        "n_sources": solution.n_sources,
        "n_data": solution.n_data,
        "chi2": float(solution.chi2),
        "reduced_chi2": float(solution.reduced_chi2),
        "errors_from": solution.errors_from,
        "error_source": str(solution.error_source),
        "includes_floor": bool(solution.includes_floor),
    }
    if is_of_scalar_field(solution):
        meta |= dict(zip(("mean", "mean_error"), solution.mean, strict=True))
    columns = {"name": np.array(list(vectors), str)} | dict(zip(column_names, values, strict=True))
    columns["detected"] = np.array([is_seen(v) for v in vectors.values()], bool)
    return tables.table_of(columns, meta, units)


def powers_table(solution: Any) -> Table:
    """Power by degree and kind as an astropy Table, with errors, chances, and roots of the powers."""
    degrees = spectrum(solution)
    numbers = ("power", "debiased", "error", "p_value", "z", "mk_z")
    columns = {"kind": np.array([degree.kind for degree in degrees]), "l": np.array([degree.l for degree in degrees])}
    columns |= {name: np.array([getattr(degree, name) for degree in degrees], float) for name in numbers}
    return tables.table_of(columns, {"frame": solution.frame}, dict.fromkeys(numbers[:3], square_of(solution.unit)))


def square_of(unit: str) -> str:
    """Square a unit: µas2 / yr2."""
    return " / ".join(f"{factor.strip()}2" for factor in unit.split("/")) if unit else ""


#: How the errors of a fit are named.
_ERROR_NAMES = {
    ErrorSource.CATALOGUE: "least squares, formal errors",
    ErrorSource.SCALED: "least squares, errors scaled by √(χ²/dof)",
    ErrorSource.FLOWS: "least squares, formal errors and those of flows",
    ErrorSource.EXCESS_NOISE: "excess noise, errors from the residuals",
    ErrorSource.RESIDUALS: "robust fit, with errors from its residuals",
    ErrorSource.BOOTSTRAP: "errors from the bootstrap", ErrorSource.JACKKNIFE: "errors from the jackknife",
    ErrorSource.JOINT: "joint fit",
}  # fmt: skip


def answer_of(solution: Any) -> Answer:
    """Lines to quote on acceleration and spin, with the errors of its own table.

    Parameters
    ----------
    solution : Solution
        A fit of proper motions or of a scalar field; of positions the answer has no lines.
    """
    solution = solution_of(solution, "answer")
    is_known = np.isfinite([*solution.covariance.diagonal(), *solution.values]).all()
    if not is_known or (solution.unit != "µas/yr" and not is_of_scalar_field(solution)):
        return Answer()
    if reason := _describe_reason_for_no_result(solution):
        return Answer(((("mean" if is_of_scalar_field(solution) else "acceleration"), f"no result: {reason}"),))
    errors_line = ("errors" if solution.is_recommended else "this fit", _describe_errors(solution))
    if is_of_scalar_field(solution):
        value, error = solution.mean
        mean_text = f"{format_with_error(value, error, '+')} {solution.unit}".rstrip()
        lines = [("mean", f"{mean_text}, p = {format_p_value(solution.p_value('F', 0))}")]
        lines += [(name, words_of(vector)) for name, vector in vectors_of(solution).items()]
    else:
        lines = [
            ("acceleration", words_of(solution.acceleration)),
            ("spin", words_of(solution.spin)),
            ("Gaia EDR3", _describe_difference_from_gaia(solution.acceleration)),
        ]
    if unit_notes := [str(note) for note in solution.notes if has_code(note, ASSUMED_UNITS)]:
        lines.append(("units", f"{'; '.join(unit_notes)}; {solution.frame} axes"))
    lines = [*doubts_of(solution.notes), *lines]
    return Answer((*lines, errors_line) if solution.is_recommended else (errors_line, *lines))


def _describe_reason_for_no_result(solution):
    """Reason why a fit has nothing to quote; None where it has something."""
    factor, codes = compute_error_factor(solution), codes_of(solution.notes)
    if factor > WRONG_UNIT_FACTOR:
        return f"residuals are {factor:.3g} times the errors. Are both in the units that were assumed?"
    if TOO_LITTLE_SCATTER in codes:
        return "residuals are far below the errors. Are both in the units that were assumed?"
    if ERRORS_TOO_SMALL in codes and not solution.is_recommended:
        return "the quoted errors say too little of the scatter. To quote: fit.recommended (no --method)"
    if repeated_rows_notes := [note for note in solution.notes if has_code(note, REPEATED)]:
        return str(repeated_rows_notes[0]).removeprefix("warning: ")
    dof = min(solution.dof_of_degree(kind, solution.modes.lowest) for kind in solution.modes.kinds)
    if dof < FEWEST_DOF:
        return f"{_describe_dof(dof)} does not determine the errors of a vector"
    return None


def compute_error_factor(solution: Any) -> float:
    """Factor by which residuals exceed the errors of the catalogue; 1 where χ² does not contradict those."""
    return max(solution.quality.factor, 1.0) if solution.error_source == ErrorSource.CATALOGUE else 1.0


def words_of(vector: Vector) -> str:
    """Size, place and p-value of a vector; an upper limit where it is not detected."""
    p_text, unit = format_p_value(vector.p_value), f" {vector.unit}" * bool(vector.unit)
    if is_seen(vector):
        return f"{format_amplitude(vector)}{unit} towards {format_direction_with_cone(vector)}, p = {p_text}"
    limit_text = f"< {format_three_digits(vector.amplitude_limit())}{unit} (95 %)"
    if vector.p_value < SEEN:
        return f"not zero (p = {p_text}), but its correlated components tell no size or direction: {limit_text}"
    hint = f" ({hint})" if (hint := hint_of(vector.p_value)) else ""
    return f"not detected: {limit_text}, p = {p_text}{hint}"


def _describe_difference_from_gaia(acceleration: Vector) -> str:
    """Distance of an acceleration from that of Gaia EDR3, in standard deviations of both together."""
    gaia = GAIA_EDR3.to_frame(acceleration.frame)
    covariance = acceleration.covariance + gaia.covariance
    dof = acceleration.dof * (np.trace(covariance) / np.trace(acceleration.covariance)) ** 2  # Satterthwaite (1946)
    difference = replace(acceleration, value=acceleration.value - gaia.value, covariance=covariance, dof=float(dof))
    p = difference.p_value
    hint = "; this may be an instrumental effect" if p < SEEN else ""
    edr3 = f"{format_with_error(gaia.amplitude, gaia.amplitude_error)} {gaia.unit}"
    return f"this acceleration is {abs(ndtri(max(p, 1e-300) / 2)):.1f} σ from {edr3} (p = {format_p_value(p)}){hint}"


def _describe_errors(solution: Any) -> str:
    """Describe the errors, what they leave out, and what to be careful of."""
    clipped = "after clipping: " if CLIPPED in codes_of(solution.notes) else ""
    description = f"{clipped}{_ERROR_NAMES[ErrorSource(solution.error_source)]}, to degree {solution.modes.lmax}"
    if solution.error_source == ErrorSource.SCALED and not solution.includes_floor:
        description += f", {solution.quality.factor:.3g} times the formal errors"
    if solution.floor is not None and solution.includes_floor:
        floor = solution.floor
        errors = ", ".join(f"{name} ± {error:.2g}" for name, error in reversed(floor.errors.items()))
        floor_text = f"{errors} {floor.unit}".rstrip() + " per component"
        description += f", systematic floor included ({floor_text})"
    elif solution.includes_floor:
        description += ", systematic errors included"
    elif solution.is_recommended:
        description += "; the systematic floor is not known" + (" below degree 3" if solution.modes.lmax < 3 else "")
    if (factor := compute_error_factor(solution)) > 1:
        description += f"; residuals are {factor:.3g} times as large"
    if not solution.includes_floor and ONE_SIDE in codes_of(solution.notes):
        degree_one_text = ", and degree 1 depends on the degrees above it" if solution.modes.lmax > 1 else ""
        description += f"; one side of the sky has no sources{degree_one_text}"
    if not solution.is_recommended:
        description += "; to quote: fit.recommended (vsh-fit without --method)"
    return description


WIDTH = 88


def sections_of(
    solution: Any,
    *,
    check: Any = None,
    truth: dict[str, Any] | None = None,
    source: str | None = None,
    long: bool = False,
) -> tuple[Section, ...]:
    """Make the sections of a solution; a cross-check, the truth of a simulation and the source are optional.

    With `long`, the sections include formal errors, the origin of the errors, and powers with their normal deviates.
    """
    solution = solution_of(solution, "report")
    facts = [*(_list_fit_facts(solution) if long else ()), *warnings_of(solution)]
    title = _format_section_title(solution, source)
    if np.isnan(solution.coefficients.values).all():
        sections = [Section(title, facts, _make_expected_errors_table(solution)), _make_noise_powers_section(solution)]
    else:
        vectors = _make_vectors_table(solution, truth or {}, long)
        remarks = [*_format_directions(solution), *_FORMAL_ERRORS_REMARK * solution.includes_floor] if long else ()
        sections = [Section(title, facts, vectors, remarks=remarks)]
        sections.append(_make_detailed_powers_section(solution) if long else _make_powers_section(solution))
    if check is not None and (long or not check.largest < AGREEMENT_LIMIT):
        sections += check.sections()
    sections[-1] = replace(sections[-1], notes=solution.notes)
    return tuple(sections)


def _format_section_title(solution, source):
    modes = solution.modes
    prefix = f"{printable(source)}: " if source else ""
    title = f"{prefix}{solution.n_sources} sources, {solution.frame} axes, degrees {modes.lowest} to {modes.lmax}"
    return title + (f", χ²/dof = {solution.reduced_chi2:.3f}" if np.isfinite(solution.chi2) else "")


def _list_fit_facts(solution):
    """Facts on the fit and the source of its errors."""
    facts = [("fit", describe_fit_subject(solution)), ("coefficients", f"{len(solution.modes)}")]
    if np.isfinite(solution.chi2):
        suffix = "" if solution.error_source == ErrorSource.CATALOGUE else " (with the catalogue's errors)"
        facts.append(("χ²/dof", f"{solution.chi2:.6g} / {solution.dof}{suffix}"))
    return [*facts, ("errors from", solution.errors_from)]


def describe_fit_subject(solution: Any) -> str:
    """Subject of a solution, the title of its page."""
    if is_of_scalar_field(solution):
        return f"Spherical harmonics of a scalar field{', in ' * bool(solution.unit)}{solution.unit}"
    return f"Vector spherical harmonics of {'differences of position' if solution.unit == 'µas' else 'proper motions'}"


#: Why formal errors may be larger than those that include more.
_FORMAL_ERRORS_REMARK = (
    "Formal errors are those of the fit without the floor, all degrees free. They can be larger than errors with the "
    "floor, because the floor is also a prior on the degrees above 1.",
)
#: A fit of fewer numbers for each coefficient is warned of.
_FEW_DATA_PER_COEFFICIENT = 4


def _describe_dof(dof):
    return f"a covariance with {dof:.0f} degrees of freedom"


def warnings_of(solution: Any) -> list[tuple[str, str]]:
    """Warnings on the errors of a solution, for all of its forms: pairs of a label and a sentence."""
    texts, size = [], len(solution.modes)
    if (warning := solution.quality.warning()) and solution.error_source == ErrorSource.CATALOGUE:
        texts.append(f"{warning}; those below are not scaled")
    too_few = [(l, dof) for kind, l in solution.modes.blocks if (dof := solution.dof_of_degree(kind, l)) < 2 * l + 1]
    if too_few and not solution.covariance_dof > 0:
        texts.append("few sources decide this fit: its errors are not known, and p-values are nan")
    elif too_few:
        degree, dof = min(too_few)
        text = f"{_describe_dof(dof)} does not determine the 2l + 1 coefficients of degree {degree}"
        texts.append(f"{text}: p-values of {len({l for l, _ in too_few})} of the degrees are nan")
    if size <= solution.dof < _FEW_DATA_PER_COEFFICIENT * size:
        text = f"{size} coefficients of {solution.n_data} numbers: errors grow with every degree"
        texts.append(f"{text}; a lower --lmax is enough for degree 1")
    if 0 < solution.dof < size:
        texts.append(f"{solution.dof} degrees of freedom for {size} coefficients: χ² says little of the errors")
    return [("warning", text) for text in texts]


def _make_expected_errors_table(solution):
    """The errors that a fit would have, of a solution without values."""
    vectors = vectors_of(solution)
    columns = {"vector": list(vectors)}
    columns |= {f"error {axis}": [vector.sigma[k] for vector in vectors.values()] for k, axis in enumerate("xyz")}
    return tables.table_of(columns, {}, {f"error {axis}": solution.unit for axis in "xyz"})


def _make_noise_powers_section(solution):
    degrees = range(1, solution.modes.lmax + 1)
    columns = {"degree": list(degrees)}
    columns |= {kind: [solution.noise_power(kind, l) for l in degrees] for kind in "TS"}
    title = f"Power of noise by degree, ∫|V|²dΩ {format_squared_unit(solution)}"
    return Section(title, (), tables.table_of(columns), forms=dict.fromkeys("TS", ".3g"))


def _make_vectors_table(solution, truth, long):
    """Spin and acceleration by component, with the truth of a simulation below them."""
    formal = vectors_of(solution.formal) if long and solution.formal is not solution else {}
    rows: list[tuple[str, ...]] = []
    if is_of_scalar_field(solution):
        mean, error = solution.mean
        rows.append(("mean", "", "", "", format_with_error(mean, error, "+")))
    rows += vector_rows(vectors_of(solution), truth, formal)
    column_heads = (f"[{solution.unit}]" if solution.unit else "vector", "x", "y", "z", "amplitude")
    return tables.table_of_rows(column_heads, rows)


def _format_directions(solution):
    """Directions of the detected vectors, in two frames."""
    direction_lines = []
    for name, vector in vectors_of(solution).items():
        if is_seen(vector) or not vector.amplitude_error > 0:
            counterpart = vector.to_frame("galactic" if vector.frame != "galactic" else "icrs")
            direction_lines.append(
                f"{name:14}{format_direction(vector)}; {format_direction(counterpart).removeprefix('towards ')}"
            )
    return direction_lines


def _make_powers_section(solution):
    """The power of each degree without its noise, and its p-value."""
    kind_names, powers = {"T": "toroidal", "S": "spheroidal", "F": "power"}, spectrum(solution)
    columns = {"degree": [str(l) for l in range(solution.modes.lowest, solution.modes.lmax + 1)]}
    for kind in solution.modes.kinds:
        kind_powers = [power for power in powers if power.kind == kind]
        columns[kind_names[kind]] = [format_with_error(power.debiased, power.error) for power in kind_powers]
        columns[f"p ({kind_names[kind]})"] = [format_p_value(power.p_value) for power in kind_powers]
    title = f"Power by degree {format_squared_unit(solution)}".rstrip()
    title += " minus that of noise, and the p-value: the probability that noise alone gives at least this power"
    return Section(title, (), tables.table_of(columns))


def _make_detailed_powers_section(solution):
    law = "exact χ², any sky" if np.isinf(solution.covariance_dof) else "Hotelling's T²: the errors are estimates"
    integrand = "|V|" if solution.modes.components == 2 else "f"
    column_heads = ("degree", "power", "debiased", "±", "√power", "p-value", "z", "M&K Z")
    remark = (
        "Debiased: power minus the mean power of noise. p-values are the probability that noise alone gives at least "
        f"this power ({law}); z is the equivalent normal deviate; M&K Z is the statistic of Mignard & "
        "Klioner (2012), valid only for a uniform sky."
    )
    title = f"Power by degree, ∫{integrand}²dΩ {format_squared_unit(solution)}"
    return Section(title, (), tables.table_of_rows(column_heads, power_rows(solution)), remarks=[remark])


def cross_check_sections(check: Any) -> tuple[Section, ...]:
    """Section on whether two solvers agree."""
    sources_text = f"on the same {check.frame.n_sources} sources"
    if check.largest < AGREEMENT_LIMIT:
        solvers_text = f"two independent solvers, {sources_text} with the catalogue's errors"
        agreement_text = f"Degree 1 fitted by {solvers_text}, agrees to {check.largest:.0e} σ."
        caution = "This agreement tests the numerical solution only; it does not validate the errors above."
        return (Section("Cross-check", remarks=[agreement_text, caution]),)
    rows = [
        (name, solver, *format_components(getattr(fitted, name)))
        for name in ("spin", "acceleration")
        for solver, fitted in (("harmonics", check.harmonics), ("frame, QR", check.frame))
    ]
    column_heads = ("[µas/yr]", "solver", "x", "y", "z")
    title = f"CROSS-CHECK FAILED: degree 1 {sources_text} by two solvers differs by {check.largest:.1e} σ"
    return (Section(title, (), tables.table_of_rows(column_heads, rows)),)


#: Differences of the two solvers below this are rounding. [σ]
AGREEMENT_LIMIT = 1e-6
