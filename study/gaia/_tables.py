"""The tables of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fit.spectrum import spectrum
from study.gaia._fits import DegreeOrSubset
from study.gaia._published import AMPLITUDE, CLIPPED, COMPONENTS, COUNTS, DEC, ERRORS, RA, SOURCES
from study.gaia._run import GaiaStudy
from vsh import tables
from vsh.checks.types import Table
from vsh.vector import Vector, correlation_of

_FRAME = [f"{v}_{axis}" for v in ("spin", "g") for axis in "xyz"]


def row_table(rows: Sequence[DegreeOrSubset], truth: Mapping[str, Any] | None = None) -> Table:
    """A row a fit: sources, components of g and of the spin with both kinds of errors, amplitude and direction."""
    good: list[Any] = [row for row in rows if row.solution is not None]
    columns: dict[str, Any] = {
        "fit": [row.name for row in good], "lmax": [row.solution.modes.lmax for row in good], "sources": [row.n_sources for row in good],
        "clipped": [row.n_clipped for row in good], "chi2_dof": [row.solution.reduced_chi2 for row in good],
    }  # fmt: skip
    for name in ("acceleration", "spin"):
        short = {"acceleration": "g", "spin": "spin"}[name]
        for k, axis in enumerate("xyz"):
            columns[f"{short}_{axis}"] = [getattr(row.resampled, name).value[k] for row in good]
            columns[f"{short}_{axis}_formal"] = [getattr(row.solution, name).sigma[k] for row in good]
            columns[f"{short}_{axis}_error"] = [getattr(row.resampled, name).sigma[k] for row in good]
    g = [row.resampled.acceleration for row in good]
    columns |= {"amplitude": [v.amplitude for v in g], "amplitude_error": [v.amplitude_error for v in g]}
    for k, name in enumerate(("ra", "dec")):
        columns |= {name: [v.direction[k] for v in g], f"{name}_error": [v.direction_error[k] for v in g]}
    if truth:
        columns["chi2_truth_of_6"] = [_against(row.resampled, truth) for row in good]
    return tables.table_of(
        columns, {"frame": "icrs"}, {name: "uas / yr" for name in columns if name[:2] in ("g_", "sp", "am")}
    )


def _against(solution, truth):
    """χ² of spin and acceleration against the truth, by the bootstrap's covariance of all six."""
    return float(sum(_chi2(getattr(solution, name), truth[name]) for name in ("spin", "acceleration")))


def _chi2(vector, true):
    away = vector.value - true.value
    return away @ np.linalg.solve(vector.covariance, away)


def power_table(study: GaiaStudy) -> Table:
    """Powers of the main fit and of the highest degree, with p-values that allow for the bootstrap's own uncertainty."""
    rows = []
    for fitted in dict.fromkeys((study.main, study.degrees[-1])):
        if fitted.resampled is not None:
            rows += [(fitted.name, f"{row.kind}{row.l}", row.power, row.debiased, row.error, row.p_value, row.z)
                     for row in spectrum(fitted.resampled)]  # fmt: skip
    names = ("fit", "of", "power", "noise_debiased", "error", "p_value", "z")
    return tables.table_of(dict(zip(names, zip(*rows, strict=True), strict=True)),
                           units=dict.fromkeys(names[2:5], "uas2 / yr2"))  # fmt: skip


def correlation_table(study: GaiaStudy) -> Table:
    """Correlations of spin and acceleration in the main fit, by the catalogue's errors."""
    from fit.correlation import FRAME, named, parameters_of

    found: Any = study.main.solution
    matrix = correlation_of(named(parameters_of(FRAME).names, found.modes).covariance(found.covariance))
    return tables.table_of({"of": _FRAME} | dict(zip(_FRAME, matrix.T, strict=True)))


def published_table(study: GaiaStudy) -> Table:
    """Each published number beside ours."""
    main: Any = study.main
    g: Vector = main.resampled.acceleration
    rows: list[Any] = [("five-parameter sources", float(SOURCES), np.nan, float(main.n_sources), np.nan)]
    magnitude = study.sources.field.magnitude
    if magnitude is not None:
        five = magnitude[~study.sources.six]
        rows += [(f"of them G ≤ {limit:g}", float(count), np.nan, float((five <= limit).sum()), np.nan)
                 for limit, count in COUNTS.items() if limit < 21]  # fmt: skip
    rows.append(("clipped, about", float(CLIPPED), np.nan, float(main.n_clipped), np.nan))
    for axis, value, error, ours, sigma in zip("xyz", COMPONENTS, ERRORS, g.value, g.sigma, strict=True):
        rows.append((f"g_{axis} [µas/yr]", value, error, ours, sigma))
    rows.append(("|g| [µas/yr]", *AMPLITUDE, g.amplitude, g.amplitude_error))
    for k, (name, published) in enumerate((("ra", RA), ("dec", DEC))):
        rows.append((f"{name} [deg]", *published, g.direction[k], g.direction_error[k]))
    names = ("number", "published", "error", "here", "error_here")
    return tables.table_of(dict(zip(names, zip(*rows, strict=True), strict=True)))
