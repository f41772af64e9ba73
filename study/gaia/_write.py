"""The study as a folder: report, tables, figures, one page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fit.background import floor
from fit.output import cell, html_report
from study.gaia._figures import CAPTIONS, draw
from study.gaia._run import GaiaStudy
from study.gaia._tables import correlation_table, power_table, published_table, row_table
from vsh import tables
from vsh.checks.types import Table
from vsh.commands.figures import without_windows
from vsh.errors import VshError
from vsh.page import Shown, write_page
from vsh.plot import close_figures, save_figures

_HEADINGS = {
    "published": "Beside the paper",
    "degrees": "By the highest degree of the fit",
    "subsets": "By subsets of the sources",
    "powers": "Powers and p-values",
    "correlations": "Correlations of spin and acceleration",
}


def write_gaia(
    study: GaiaStudy,
    folder: Path,
    *,
    truth: Mapping[str, Any] | None = None,
    provenance: Mapping[str, Any] | None = None,
    figures: Mapping[str, Any] | None = None,
) -> str:
    """Write everything; returns the report.

    Parameters
    ----------
    study : GaiaStudy
        What was found.
    folder : Path
        Where to, an empty folder.
    truth : dict, optional
        Of a simulated catalogue.
    provenance : dict, optional
        Plain values.
    figures : dict, optional
        As for `vsh.plot.save_figures`: format and dpi; None for no files of figures.
    """
    without_windows()
    made = {
        "published": published_table(study),
        "degrees": row_table(study.degrees, truth),
        "subsets": row_table(study.subsets, truth),
        "powers": power_table(study),
        "correlations": correlation_table(study),
    }
    for name, table in made.items():
        tables.write_table(table, folder / f"{name}.ecsv")
    drawn = draw(study, truth)
    if figures is not None:
        save_figures(drawn, folder, **figures, close=False)
    text = _report(study, made, truth)
    (folder / "report.md").write_text(text, encoding="utf-8")
    main: Any = study.main
    five = study.sources.field[~study.sources.six]
    page = html_report(
        main.resampled, drawn, check=study.check, truth=None if truth is None else dict(truth), source=study.sources.label,
        provenance=dict(provenance or {}), title="The acceleration of the Solar System from Gaia's quasars",
        sections={_HEADINGS[name]: table for name, table in made.items()}, captions=CAPTIONS,
        skies=[Shown("degree 3, errors from the bootstrap", five, main.solution.coefficients, main.resampled.covariance)],
    )  # fmt: skip
    close_figures(drawn.values())
    write_page(folder / "gaia.html", page)
    return text


def _report(study, made, truth):
    main, g = study.main, study.main.resampled.acceleration
    lines = [
        "# The acceleration of the Solar System from Gaia's quasars",
        "",
        f"{study.sources.label}: {main.n_sources} five-parameter and {int(study.sources.six.sum())} six-parameter sources. "
        f"Fits of degree 3 to five-parameter sources, clipped at κ = 3 ({main.n_clipped} left out), errors from "
        f"{main.resampled.errors_from}, unless a table says otherwise. After Gaia Collaboration, Klioner et al. (2021, A&A 649, A9).",
        "",
        f"**g = ({', '.join(f'{v:+.2f} ± {s:.2f}' for v, s in zip(g.value, g.sigma, strict=True))}) µas/yr**: "
        f"{g.amplitude:.2f} ± {g.amplitude_error:.2f} µas/yr toward α = {g.direction[0]:.1f}° ± {g.direction_error[0]:.1f}°, "
        f"δ = {g.direction[1]:+.1f}° ± {g.direction_error[1]:.1f}°. {_floor_words(main.solution, g)}",
    ]
    if truth:
        listed = ", ".join(f"{v:+.3f}" for v in truth["acceleration"].value)
        draws = main.resampled.covariance_dof
        expected = 6 * draws / (draws - 4)  # of three numbers with a covariance from so many draws, twice
        lines += ["", f"A simulated catalogue; the truth is g = ({listed}) µas/yr. The last column of the tables is χ² of spin and g "
                  f"against it, {expected:.1f} ± {np.sqrt(12) * expected / 6:.1f} where the errors are right."]  # fmt: skip
    for name, table in made.items():
        lines += ["", f"## {_HEADINGS[name]}", "", *_markdown(_shown(name, table))]
    lines += [
        "",
        "Thirds of colour are by the effective wavenumber, nu_eff_used_in_astrometry; halves of the sky are fitted to degree 1.",
    ]
    failed = [row for row in (*study.degrees, *study.subsets) if row.solution is None]
    if failed:
        lines += ["", "## Without a result", "", *(f"* {row.name}: {row.said}" for row in failed)]
    notes = study.sources.field.notes
    lines += ["", "## Notes", "", *(f"* {note}" for note in notes)] if notes else []
    return "\n".join(lines) + "\n"


def _floor_words(solution, g):
    """What errors that sources share add to the first line."""
    try:
        shared = floor(solution, range(2, solution.modes.lmax + 1))
    except VshError:
        return "Errors that sources share are not in it: there are too few sources to estimate them."
    total = ", ".join(f"{np.hypot(s, shared.acceleration_error):.2f}" for s in g.sigma)
    low, high = shared.acceleration_interval
    return (
        f"Not in these errors: what sources share, ± {shared.acceleration_error:.2f} µas/yr in each component ({low:.2f} … {high:.2f}, "
        f"68 %) from the power of degrees 2 to {solution.modes.lmax}; with it ± ({total}) µas/yr."
    )


def _shown(name, table):
    """What a page is wide enough for; the files have all."""
    if name not in ("degrees", "subsets"):
        return table
    kept = [column for column in table.colnames if not (column.startswith("spin") or column.endswith("_formal"))]
    return table[kept]


def _markdown(table: Table) -> list[str]:
    lines = [
        "| " + " | ".join(name.replace("_", " ") for name in table.colnames) + " |",
        "|" + "---|" * len(table.colnames),
    ]
    for row in zip(*(table[name].tolist() for name in table.colnames), strict=True):
        lines.append("| " + " | ".join(cell(each).replace("|", "\\|") for each in row) + " |")
    return lines
