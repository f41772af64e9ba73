"""A solution as tables of numbers: what a program reads where a person reads the report."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.harmonic import HarmonicSolution
from fit.output._rows import vectors_of
from fit.spectrum import spectrum
from vsh import tables
from vsh.checks.types import Table


def vectors_table(solution: Any) -> Table:
    """Spin and acceleration (rotation and glide; a dipole) as an astropy Table, a row each."""
    vectors = vectors_of(solution)
    names = (
        "amplitude", "amplitude_error", "debiased_amplitude", "limit_95", "lon", "lat", "lon_error", "lat_error", "p_value",
    )  # fmt: skip
    # The chance of a degree knows of how many replicates the errors are; a vector does not.
    chances = {d.kind: d.p_value for d in spectrum(solution) if d.l == 1}
    kinds = dict(zip(vectors, "TS" if len(vectors) > 1 else "S", strict=False))
    rows = [
        (*v.value, *v.sigma, *v.covariance[np.triu_indices(3, 1)], v.amplitude, v.amplitude_error, v.debiased_amplitude, v.amplitude_limit(0.95),
         *v.direction, *v.direction_error, chances.get(kinds[name], v.p_value))
        for name, v in vectors.items()
    ]  # fmt: skip
    heads = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "cov_xy", "cov_xz", "cov_yz", *names)
    values = np.array(rows, float).reshape(-1, len(heads)).T
    unit = solution.unit.replace("µ", "u")  # as astropy writes it
    units = dict.fromkeys(heads[:6] + names[:4], unit) | dict.fromkeys(heads[6:9], _squared(unit))
    units |= dict.fromkeys(names[4:8], "deg")
    meta = {
        "frame": solution.frame, "lmax": solution.modes.lmax, "n_sources": solution.n_sources, "n_data": solution.n_data,
        "chi2": float(solution.chi2), "reduced_chi2": float(solution.reduced_chi2), "errors_from": solution.errors_from,
    }  # fmt: skip
    columns = {"name": np.array(list(vectors), str)} | dict(zip(heads, values, strict=True))
    return tables.table_of(columns, meta, {name: each for name, each in units.items() if each})


def powers_table(solution: HarmonicSolution) -> Table:
    """Power by degree and kind as an astropy Table, with errors, chances, and roots of the powers."""
    found = spectrum(solution)
    numbers = ("power", "debiased", "error", "p_value", "z", "mk_z")
    columns = {"kind": np.array([d.kind for d in found]), "l": np.array([d.l for d in found])}
    columns |= {name: np.array([getattr(d, name) for d in found], float) for name in numbers}
    unit = _squared(solution.unit.replace("µ", "u"))
    return tables.table_of(columns, {"frame": solution.frame}, dict.fromkeys(numbers[:3], unit) if unit else {})


def _squared(unit):
    """As astropy writes it: uas2 / yr2."""
    return " / ".join(f"{part.strip()}2" for part in unit.split("/")) if unit else ""
