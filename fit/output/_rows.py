"""What is printed of vectors and powers: the one place that text, page, notebook and LaTeX take their rows from."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fit.quality import SEEN
from fit.quality import printed_p_value as p_value
from fit.spectrum import spectrum
from vsh.io import tables
from vsh.io.tables import three_digits, two_digits
from vsh.sky.frames import ANGLES
from vsh.tools.types import FloatArray, Table
from vsh.vector import Vector


class VectorRow(NamedTuple):
    """One line of the table of vectors."""

    name: str
    cells: tuple
    amplitude: str
    is_truth: bool


def vector_rows(vectors: Mapping[str, Vector], truth: Mapping[str, Vector] | None = None) -> list[VectorRow]:
    """Rows of the table of vectors."""
    rows = []
    for name, vector in vectors.items():
        rows.append(VectorRow(name, components(vector), amplitude(vector), False))
        true = (truth or {}).get(name)
        if true is not None:
            true = true.to_frame(vector.frame)
            cells = zip(true.value, pulls(vector, true), strict=True)
            digits = two_digits(vector.sigma)
            shown = tuple(f"{t:+.{digits}f} ({d:+.1f}σ)" for t, d in cells)
            rows.append(VectorRow("truth", shown, f"{true.amplitude:.{digits}f}", True))
    return rows


def vectors_of(solution: Any) -> dict[str, Vector]:
    """Spin and acceleration of a solution by name; rotation and glide of positions, the dipole of a scalar field."""
    if is_scalar(solution):
        return {"dipole": solution.dipole} if solution.modes.lmax > 0 else {}
    names = ("rotation", "glide") if solution.unit == "µas" else ("spin", "acceleration")
    return dict(zip(names, (solution.spin, solution.acceleration), strict=True))


def is_scalar(solution: Any) -> bool:
    """Whether it is of a scalar field, which has a mean and a dipole in place of spin and acceleration."""
    return solution.modes.components == 1


def squared(solution: Any) -> str:
    """The unit of powers, in brackets; nothing of pure numbers."""
    return f"[({solution.unit})²]" if solution.unit else ""


def pulls(vector: Vector, true: Vector) -> FloatArray:
    """How far a fit is from the truth in its own errors, (3,): positive where the fit is larger."""
    return (vector.value - true.to_frame(vector.frame).value) / vector.sigma


def components(vector: Vector) -> tuple[str, ...]:
    """Three components with their errors, of which the smallest has two digits."""
    digits = two_digits(vector.sigma)
    pairs = zip(vector.value, vector.sigma, strict=True)
    return tuple(f"± {s:.{digits}f}" if np.isnan(v) else f"{v:+.{digits}f} ± {s:.{digits}f}" for v, s in pairs)


def amplitude(vector: Vector) -> str:
    """Length with its error where the vector is detected, otherwise its upper limit."""
    if np.isnan(vector.amplitude):  # errors of a fit that is to come
        return ""
    if not vector.amplitude_error > 0:
        return f"{vector.amplitude:.3f}"
    if is_seen(vector):
        digits = two_digits(vector.amplitude_error)
        return f"{vector.amplitude:.{digits}f} ± {vector.amplitude_error:.{digits}f}"
    return f"< {three_digits(vector.amplitude_limit(0.95))} (95 %)"


def is_seen(vector: Vector) -> bool:
    """Whether a vector is detected: whether there is an amplitude and a direction to speak of."""
    return bool(vector.p_value < SEEN)


def place(vector: Vector) -> str:
    """Where a vector points, with its cone of 68 %: "α = 269°, δ = −28° (± 7°)"."""
    names = ANGLES[vector.frame]
    listed = ", ".join(f"{name} = {value:.0f}°" for name, value in zip(names, vector.direction, strict=True))
    return f"{listed} (± {vector.direction_cone():.0f}°)"


def direction(vector: Vector) -> str:
    """Where a vector points, named after the frame: with errors, or with a cone where they are large."""
    names = ANGLES[vector.frame]
    errors = vector.direction_error
    if not vector.amplitude_error > 0 or (is_seen(vector) and max(errors) <= 40):
        pairs = zip(names, vector.direction, errors, strict=True)
        return "towards " + ", ".join(f"{name} = {value:.1f} ± {error:.1f}°" for name, value, error in pairs)
    return f"towards {place(vector)}" if is_seen(vector) else "direction not determined"


class PowerRow(NamedTuple):
    """One line of the table of powers, as text."""

    degree: str
    power: str
    debiased: str
    error: str
    root: str
    p_value: str
    z: str
    mk_z: str


def power_rows(solution: Any) -> list[PowerRow]:
    """Rows of the table of powers."""
    return [
        PowerRow(
            f"{d.kind}{d.l}",
            f"{d.power:.5g}",
            f"{d.debiased:.5g}",
            f"{d.error:.3g}",
            f"{np.sqrt(d.power):.3g}",
            p_value(d.p_value),
            f"{d.z:.2f}",
            f"{d.mk_z:.2f}",
        )
        for d in spectrum(solution)
    ]


def cell(value: Any) -> str:
    """A number of a table for reading: four digits, none behind the point from a thousand on, nothing for nan."""
    if not isinstance(value, float):
        return str(value)
    return "" if value != value else f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"


def vectors_table(solution: Any) -> Table:
    """Spin and acceleration (rotation and glide; a dipole) as an astropy Table, a row each.

    Errors are those of the result; formal ones, N⁻¹ by the weights of the fit, stand beside them. lon and lat are nan
    where the vector is not detected; fitted_lon and fitted_lat are there always.
    """
    vectors, formal = vectors_of(solution), vectors_of(solution.formal)
    lengths = ("amplitude", "amplitude_error", "debiased_amplitude", "low_68", "high_68", "limit_95")
    angles = ("lon", "lat", "lon_error", "lat_error", "fitted_lon", "fitted_lat")
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
    heads = (*components, *products, *lengths, *angles, "p_value")
    values = np.array(rows, float).reshape(-1, len(heads)).T
    unit = solution.unit.replace("µ", "u")  # as astropy writes it
    units = dict.fromkeys((*components, *lengths), unit) | dict.fromkeys(products, _squared(unit))
    units |= dict.fromkeys(angles, "deg")
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
    columns = {"name": np.array(list(vectors), str)} | dict(zip(heads, values, strict=True))
    columns["detected"] = np.array([is_seen(v) for v in vectors.values()], bool)
    return tables.table_of(columns, meta, {name: each for name, each in units.items() if each})


def powers_table(solution: Any) -> Table:
    """Power by degree and kind as an astropy Table, with errors, chances, and roots of the powers."""
    degrees = spectrum(solution)
    numbers = ("power", "debiased", "error", "p_value", "z", "mk_z")
    columns = {"kind": np.array([d.kind for d in degrees]), "l": np.array([d.l for d in degrees])}
    columns |= {name: np.array([getattr(d, name) for d in degrees], float) for name in numbers}
    unit = _squared(solution.unit.replace("µ", "u"))
    return tables.table_of(columns, {"frame": solution.frame}, dict.fromkeys(numbers[:3], unit) if unit else {})


def _squared(unit):
    """As astropy writes it: uas2 / yr2."""
    return " / ".join(f"{part.strip()}2" for part in unit.split("/")) if unit else ""
