"""What is printed of vectors and powers: the one place that text, page, notebook and LaTeX take their rows from."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from fit.quality import printed_p_value as p_value
from fit.spectrum import spectrum
from vsh.io import tables
from vsh.sky.frames import ANGLES
from vsh.tools.types import FloatArray, Table
from vsh.vector import Vector

#: From this signal to noise on, a length has a symmetric error.
_SURE = 3.0


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
            rows.append(
                VectorRow("truth", tuple(f"{t:+.3f} ({d:+.1f}σ)" for t, d in cells), f"{true.amplitude:.3f}", True)
            )
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


def components(vector: Vector, digits: int = 3) -> tuple[str, ...]:
    """Three components with their errors."""
    pairs = zip(vector.value, vector.sigma, strict=True)
    return tuple(f"± {s:.{digits}f}" if np.isnan(v) else f"{v:+.{digits}f} ± {s:.{digits}f}" for v, s in pairs)


def amplitude(vector: Vector, digits: int = 3) -> str:
    """Length with its error; at low signal to noise its 68 % interval, or an upper limit where not significant."""
    if np.isnan(vector.amplitude):  # errors of a fit that is to come
        return ""
    if not vector.amplitude_error > 0:
        return f"{vector.amplitude:.{digits}f}"
    if vector.amplitude >= _SURE * vector.amplitude_error:
        return f"{vector.amplitude:.{digits}f} ± {vector.amplitude_error:.{digits}f}"
    if vector.p_value > 0.05 or vector.dof < 3:
        return f"< {vector.amplitude_limit(0.95):.{digits}f} (95 %)"
    low, high = vector.amplitude_interval(0.68)
    return f"{low:.{digits}f} … {high:.{digits}f} (68 %)"


def is_seen(vector: Vector) -> bool:
    """Whether there is an amplitude and a direction to speak of; otherwise a limit says all there is."""
    return bool(vector.p_value <= 0.05)


def direction(vector: Vector) -> str:
    """Where a vector points: "toward …", named after the frame, with errors; at low signal to noise with a cone."""
    names = ANGLES[vector.frame]
    errors = vector.direction_error
    if vector.amplitude_error > 0 and (vector.amplitude < _SURE * vector.amplitude_error or max(errors) > 40):
        place = ", ".join(f"{name} = {value:+.1f}°" for name, value in zip(names, vector.direction, strict=True))
        if vector.p_value > 0.05 or vector.dof < 3:
            return f"direction not determined (fitted: {place})"
        return f"toward {place}, within {vector.direction_cone():.0f}° (68 %)"
    pairs = zip(names, vector.direction, errors, strict=True)
    return "toward " + ", ".join(f"{name} = {value:+6.1f} ± {error:.1f}°" for name, value, error in pairs)


class PowerRow(NamedTuple):
    """One line of the table of powers, as text."""

    degree: str
    power: str
    debiased: str
    error: str
    root: str
    p_value: str
    p_value_scaled: str
    z: str
    mk_z: str


def power_rows(solution: Any) -> list[PowerRow]:
    """Rows of the table of powers; the second p-value is with errors scaled by √(χ²/dof) where χ² asks for it."""
    scaled = spectrum(solution.scaled)
    return [
        PowerRow(
            f"{d.kind}{d.l}",
            f"{d.power:.5g}",
            f"{d.debiased:.5g}",
            f"{d.error:.3g}",
            f"{np.sqrt(d.power):.3g}",
            p_value(d.p_value),
            p_value(s.p_value),
            f"{d.z:.2f}",
            f"{d.mk_z:.2f}",
        )
        for d, s in zip(spectrum(solution), scaled, strict=True)
    ]


def is_scaled(solution: Any) -> bool:
    """Whether p-values are shown twice: as quoted, and with scaled errors."""
    return solution.scaled is not solution


def cell(value: Any) -> str:
    """A number of a table for reading: four digits, none behind the point from a thousand on, nothing for nan."""
    if not isinstance(value, float):
        return str(value)
    return "" if value != value else f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"


def vectors_table(solution: Any) -> Table:
    """Spin and acceleration (rotation and glide; a dipole) as an astropy Table, a row each.

    lon and lat are nan where the direction is that of noise; fitted_lon and fitted_lat are there always.
    """
    vectors = vectors_of(solution)
    names = (
        "amplitude",
        "amplitude_error",
        "debiased_amplitude",
        "limit_95",
        "lon",
        "lat",
        "lon_error",
        "lat_error",
        "p_value",
        "fitted_lon",
        "fitted_lat",
    )
    # The chance of a degree knows of how many replicates the errors are; a vector does not.
    chances = {d.kind: d.p_value for d in spectrum(solution) if d.l == 1}
    kinds = dict(zip(vectors, "TS" if len(vectors) > 1 else "S", strict=False))
    rows = [
        (
            *v.value,
            *v.sigma,
            *v.covariance[np.triu_indices(3, 1)],
            v.amplitude,
            v.amplitude_error,
            v.debiased_amplitude if is_seen(v) else np.nan,
            v.amplitude_limit(0.95),
            *((*v.direction, *v.direction_error) if is_seen(v) else (np.nan,) * 4),
            chances.get(kinds[name], v.p_value),
            *v.direction,
        )
        for name, v in vectors.items()
    ]
    heads = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "cov_xy", "cov_xz", "cov_yz", *names)
    values = np.array(rows, float).reshape(-1, len(heads)).T
    unit = solution.unit.replace("µ", "u")  # as astropy writes it
    units = dict.fromkeys(heads[:6] + names[:4], unit) | dict.fromkeys(heads[6:9], _squared(unit))
    units |= dict.fromkeys((*names[4:8], *names[9:]), "deg")
    meta = {
        "frame": solution.frame,
        "lmax": solution.modes.lmax,
        "n_sources": solution.n_sources,
        "n_data": solution.n_data,
        "chi2": float(solution.chi2),
        "reduced_chi2": float(solution.reduced_chi2),
        "errors_from": solution.errors_from,
    }
    columns = {"name": np.array(list(vectors), str)} | dict(zip(heads, values, strict=True))
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
