"""The paper on the acceleration of the Solar System (Klioner et al. 2021, A&A 649, A9): its fits, as a folder.

    vsh-sim crf3 --output crf3.fits
    python papers/klioner2021/acceleration_paper.py crf3.fits --output gaia

`make gaia FILE=crf3.fits` does the second; FILE may be one of `vsh-archive gaia-crf3` as well. `vsh-referee` tells what
systematic errors leave of the same numbers.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from fit import CrossCheck, Solution, cross_check
from fit.background import floor
from fit.resample import bootstrap
from fit.results.output import cell, plot_correlation, plot_residuals, plot_spectrum, write_html
from fit.results.spectrum import spectrum
from fit.robust import clip
from study.referee._rows import read_papers
from vsh import Field
from vsh.classes import Classes
from vsh.commands.running import provenance
from vsh.figures.plot import (
    COLOURS,
    WIDTH,
    apply_style,
    close_figures,
    legend_above,
    panels,
    plot_field,
    plot_map,
    save_figures,
)
from vsh.io import tables
from vsh.io.archive import DR3, DR4
from vsh.io.catalogue import Columns, read_field, truth_of
from vsh.io.columns import missing_column
from vsh.io.sections import Section
from vsh.sky.pixels import pixels_of
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError, TableError, VshError
from vsh.tools.files import atomic_folder
from vsh.tools.notebook import InNotebook
from vsh.tools.notes import count_dropped
from vsh.tools.parallel import progress_bar
from vsh.tools.types import BoolArray, FloatArray, Rng, Table
from vsh.vector import Vector, correlation_of

#: One page with everything.
_PAGE = "gaia.html"
#: As in the paper.
KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class DegreeOrSubset(InNotebook):
    """Result of one fit, or why there is none."""

    name: str
    n_sources: int
    n_clipped: int
    solution: Solution | None
    resampled: Solution | None
    said: str = ""


def fit_sources(name: str, field: Field, lmax: int, n_replicates: int, rng: Rng) -> DegreeOrSubset:
    """Clip, fit and draw again."""
    try:
        fit = clip(field, lmax, KAPPA)
        solution = bootstrap(fit.sources(field), lmax, n_replicates, rng, progress=False).resampled_solution
    except VshError as error:
        return DegreeOrSubset(name, len(field), 0, None, None, str(error))
    # The sources were kept because they fit: their scatter is too small, and so seems their influence.
    covariance, quality = solution.covariance * fit.factor**4, fit.solution
    solution = replace(solution, covariance=covariance, chi2=quality.chi2, notes=quality.notes)
    return DegreeOrSubset(name, len(field), fit.n_clipped, quality, solution)


_NEEDED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
_FURTHER = ("pmra_pmdec_corr", "phot_g_mean_mag", "nu_eff_used_in_astrometry", "used_for_reference_frame_spin")
#: Fewer sources say nothing.
FEWEST = 100
#: Inside |sin b| = 0.1 stars hide among the quasars.
PLANE = 0.1


@dataclass(frozen=True, eq=False)
class Sources(InNotebook):
    """Sources that can be used."""

    field: Field
    six: BoolArray
    wavenumber: FloatArray | None
    for_spin: BoolArray | None
    label: str


def read_gaia(path: Any) -> Sources:
    """Read quasars from a file in the columns of Gaia's archive.

    Parameters
    ----------
    path : path or table
        File from `vsh-archive gaia-crf3`, or from `vsh-sim crf3`.

    Returns
    -------
    Sources
        Without those that are no single sources or cannot be used otherwise; notes of its field count them.

    Raises
    ------
    TableError
        If a column is missing.
    FieldError
        If no source can be used.
    """
    table_source = tables.open_table(path)
    for name in _NEEDED:
        if name not in table_source.names:
            raise TableError(f"{table_source.label}: {missing_column(name, table_source)}")
    solution = next((name for name in (DR4.solution, DR3.solution) if name in table_source.names), None)
    names = [*_NEEDED, *(name for name in _FURTHER if name in table_source.names), *([solution] if solution else [])]
    columns = table_source.columns(names)
    table = {
        name: np.ma.MaskedArray(values, False if mask is None else mask) for name, (values, mask) in columns.items()
    }
    rows = np.arange(len(table["ra"]))
    units = {name: unit for name, unit in table_source.units.items() if name in _NEEDED}
    field = read_field(table | {"row": rows}, Columns(name="row", redshift=None), units, on_bad="drop")
    indices = np.asarray(field.name)
    notes = [f"no column {name}: no subsets by it" for name in _FURTHER[1:] if name not in table_source.names]
    if solution is None:
        notes.append(f"warning: no column {DR3.solution}: all sources are taken as five-parameter solutions")
    field = field.add_note(*notes)

    def column(name, fill):
        return None if name not in table else np.ma.filled(table[name].astype(type(fill)), fill)[indices]

    six = np.zeros(len(indices), bool) if solution is None else np.ma.filled(table[solution], 0)[indices] == 95
    return Sources(field, six, column(_FURTHER[2], np.nan), column(_FURTHER[3], False), table_source.label)


def subsets(sources: Sources) -> dict[str, BoolArray]:
    """The parts of the sky and of the sources that are fitted, by name, (n,) masks each."""
    field, five = sources.field, ~sources.six
    masks = {"five parameters": five, "six parameters": sources.six, "all": five | sources.six}
    if field.magnitude is not None:
        masks |= dict(Classes.by_edges("G", (18, 19, 20), field.magnitude, closed="right").within(five))
    if sources.wavenumber is not None and np.isfinite(sources.wavenumber[five]).any():
        nu = sources.wavenumber
        lower, upper = np.nanquantile(nu[five], [1 / 3, 2 / 3])
        masks |= {
            "red third": five & (nu < lower),
            "middle third": five & (nu >= lower) & (nu < upper),
            "blue third": five & (nu >= upper),
        }
    masks |= {name: five & mask for name, mask in _position_errors(field).items()}
    if sources.for_spin is not None:
        masks["used for the frame's spin"] = five & sources.for_spin
    return masks


def _position_errors(field):
    galactic = field.to_frame("galactic")
    l, b = galactic.lon, galactic.lat
    masks = {
        "without the Galactic plane": np.abs(np.sin(b)) >= PLANE,
        "|b| < 30°": np.abs(b) < np.pi / 6,
        "|b| ≥ 30°": np.abs(b) >= np.pi / 6,
    }
    for frame in ("galactic", "ecliptic", "icrs"):
        masks |= dict(Classes.by_halves(frame).of(field))
    return masks | {"half toward the centre": np.cos(l) >= 0, "half away from it": np.cos(l) < 0}


#: The degree of the paper's main fit.
LMAX = 3


@dataclass(frozen=True, eq=False)
class GaiaStudy(InNotebook):
    """Results of the study."""

    sources: Sources
    degrees: list[DegreeOrSubset]
    subsets: list[DegreeOrSubset]
    check: CrossCheck

    @property
    def main(self) -> DegreeOrSubset:
        """The fit of degree 3 to all five-parameter sources."""
        return self.degrees[min(LMAX, len(self.degrees)) - 1]


def run_gaia(
    sources: Sources, *, max_lmax: int = 10, n_replicates: int = 500, rng: Rng = 1, progress: bool = True
) -> GaiaStudy:
    """Fit everything that the paper fits.

    Parameters
    ----------
    sources : Sources
        Sources as `read_gaia` gives them.
    max_lmax : int
        The table of degrees goes from 1 to it.
    n_replicates : int
        Replicates of each bootstrap.
    rng : Generator or int
        The source of all randomness.
    progress : bool
        Show a bar, after two seconds.

    Raises
    ------
    DegeneracyError
        If the five-parameter sources cannot bear the main fit.
    """
    five = sources.field[~sources.six]
    masks = subsets(sources)
    if not len(five):
        raise DegeneracyError(f"{sources.label} holds no five-parameter solutions, which the study is about")
    work: list[Any] = [(f"degree {lmax}", five, lmax) for lmax in range(1, max_lmax + 1)]
    enough = {name: mask for name, mask in masks.items() if mask.sum() >= FEWEST}
    work += [(name, sources.field[mask], 1 if "half" in name else LMAX) for name, mask in enough.items()]
    # A stream for each row, so that one more does not shift the others.
    streams = generator(rng).spawn(len(work))
    rows = []
    bar = progress_bar(list(zip(work, streams, strict=True)), words="fits", shown=progress)
    for (name, field, lmax), stream in bar:
        rows.append(fit_sources(name, field, lmax, n_replicates, stream))
    degrees, subset_rows = rows[:max_lmax], rows[max_lmax:]
    subset_rows += [
        DegreeOrSubset(name, int(mask.sum()), 0, None, None, f"{mask.sum()} sources, fewer than {FEWEST}")
        for name, mask in masks.items()
        if name not in enough
    ]
    study = GaiaStudy(sources, degrees, subset_rows, cross_check(five))
    if study.main.solution is None:
        raise DegeneracyError(f"the fit of degree {LMAX} to the five-parameter sources: {study.main.said}")
    return study


#: Systematic errors is taken from this degree or lower ones: higher ones tell less of degree 1.
_HIGHEST = 7
CAPTIONS = {
    "acceleration_by_degree": (
        "The acceleration by the highest degree of the fit: thick bars from the bootstrap, thin ones the "
        "catalogue's; bands: the published values."
    ),
    "acceleration_by_subset": (
        "The acceleration by subsets of the sources: bars from the bootstrap; lines: all five-parameter sources."
    ),
    "density": "Sources a square degree.",
    "powers": "Power by degree of the highest fit, errors from the bootstrap.",
}


def draw(study: GaiaStudy, truth: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """All figures, by name."""
    main: Any = study.main
    five = study.sources.field[~study.sources.six]
    highest: Any = next((row for row in reversed(study.degrees) if row.resampled is not None), main)
    return {
        "acceleration_by_degree": _by_degree(study.degrees, truth),
        "acceleration_by_subset": _by_subset(study.subsets),
        "powers": plot_spectrum(highest.resampled),
        "density": _density(five),
        "sky": plot_field(five, main.solution.coefficients, covariance=main.resampled.covariance),
        "correlation": plot_correlation(main.solution),
        "residuals": plot_residuals(main.solution, five),
    }


@apply_style
def _by_degree(rows, truth):
    (axes,) = panels(None, size=(WIDTH, 2.7))
    good = [(i + 1, row) for i, row in enumerate(rows) if row.resampled is not None]
    published_numbers = [read_papers()["klioner2021"][f"g_{axis}"] for axis in "xyz"]
    reference = truth["acceleration"].value if truth else [number.value for number in published_numbers]
    for k, (axis, colour) in enumerate(zip("xyz", COLOURS, strict=False)):
        x = np.array([lmax for lmax, _ in good]) + (k - 1) * 0.15
        value = [row.resampled.acceleration.value[k] for _, row in good]
        thin = [row.solution.acceleration.sigma[k] for _, row in good]
        axes.errorbar(x, value, thin, fmt="none", color=colour, linewidth=0.6)
        thick = [row.resampled.acceleration.sigma[k] for _, row in good]
        axes.errorbar(
            x, value, thick, fmt="os^"[k], color=colour, linewidth=1.8, capsize=0, alpha=0.7, label=f"$g_{axis}$"
        )
        if truth:
            axes.axhline(reference[k], color=colour, linestyle=":")
        else:
            error = published_numbers[k].error
            axes.axhspan(reference[k] - error, reference[k] + error, color=colour, alpha=0.12, linewidth=0)
    axes.set_xticks([lmax for lmax, _ in good])
    axes.set(xlabel="highest degree of the fit", ylabel="acceleration  [µas/yr]")
    legend_above(axes, 3)
    axes.set_title(
        "dotted: the truth" if truth else "bands: Klioner et al. (2021), degree 3", loc="right", fontsize=6.5
    )
    return axes


@apply_style
def _by_subset(rows: Sequence[DegreeOrSubset]) -> Any:
    good: list[Any] = [row for row in rows if row.resampled is not None]
    axes_array = panels(None, 1, 3, size=(WIDTH, 0.16 * max(len(good), 3) + 0.7), sharey=True)
    if not good:  # no subset has sources enough
        axes_array[1].set_title("no subset has sources enough", fontsize=6.5)
        return axes_array
    y = -np.arange(len(good))
    for k, (axes, axis, colour) in enumerate(zip(axes_array, "xyz", COLOURS, strict=False)):
        value = np.array([row.resampled.acceleration.value[k] for row in good])
        error = np.array([row.resampled.acceleration.sigma[k] for row in good])
        axes.errorbar(value, y, xerr=error, fmt="os^"[k], color=colour, markersize=2.5)
        axes.axvline(value[0], color="0.6", linewidth=0.6, zorder=0)
        # Small subsets do not set the scale for all.
        reach = 6 * np.median(error)
        axes.set_xlim(value[0] - reach, value[0] + reach)
        axes.set_xlabel(f"$g_{axis}$  [µas/yr]")
    axes_array[0].set_yticks(y, [f"{row.name} ({row.n_sources})" for row in good], fontsize=5.5)
    return axes_array


def _density(field):
    nside = 2 ** int(np.clip(np.log2(len(field) / 120) / 2, 2, 6))  # ten sources in a pixel
    counts = np.bincount(pixels_of(field.lon, field.lat, nside), minlength=12 * nside**2) / (41253 / (12 * nside**2))
    density = np.where(counts > 0, counts, np.nan)
    return plot_map(
        density, "sources a square degree", frame=field.frame, vmin=0, vmax=np.percentile(counts, 99), extend="max"
    )


_FRAME = [f"{v}_{axis}" for v in ("spin", "g") for axis in "xyz"]


def row_table(rows: Sequence[DegreeOrSubset], truth: Mapping[str, Any] | None = None) -> Table:
    """A row a fit: sources, components of g and of the spin with both kinds of errors, amplitude and direction."""
    good: list[Any] = [row for row in rows if row.solution is not None]
    columns: dict[str, Any] = {
        "fit": [row.name for row in good],
        "lmax": [row.solution.modes.lmax for row in good],
        "sources": [row.n_sources for row in good],
        "clipped": [row.n_clipped for row in good],
        "chi2_dof": [row.solution.reduced_chi2 for row in good],
    }
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
        columns["chi2_truth_of_6"] = [_compare_with_truth(row.resampled, truth) for row in good]
    return tables.table_of(
        columns, {"frame": "icrs"}, {name: "uas / yr" for name in columns if name[:2] in ("g_", "sp", "am")}
    )


def _compare_with_truth(solution, truth):
    """χ² of spin and acceleration against the truth, by the bootstrap's covariance of all six."""
    return float(sum(_chi2(getattr(solution, name), truth[name]) for name in ("spin", "acceleration")))


def _chi2(vector, true):
    difference = vector.value - true.value
    return difference @ np.linalg.solve(vector.covariance, difference)


def power_table(study: GaiaStudy) -> Table:
    """Powers of the main fit and of the highest degree, with p-values that allow for the bootstrap's uncertainty."""
    rows = []
    for fitted in dict.fromkeys((study.main, study.degrees[-1])):
        if fitted.resampled is not None:
            rows += [
                (fitted.name, f"{row.kind}{row.l}", row.power, row.debiased, row.error, row.p_value, row.z)
                for row in spectrum(fitted.resampled)
            ]
    names = ("fit", "of", "power", "noise_debiased", "error", "p_value", "z")
    return tables.table_of(
        dict(zip(names, zip(*rows, strict=True), strict=True)), units=dict.fromkeys(names[2:5], "uas2 / yr2")
    )


def correlation_table(study: GaiaStudy) -> Table:
    """Correlations of spin and acceleration in the main fit, by the catalogue's errors."""
    from fit.correlation import FRAME, parameters_of, select_parameters

    solution: Any = study.main.solution
    matrix = correlation_of(
        select_parameters(parameters_of(FRAME).names, solution.modes).covariance(solution.covariance)
    )
    return tables.table_of({"of": _FRAME} | dict(zip(_FRAME, matrix.T, strict=True)))


def published_table(study: GaiaStudy) -> Table:
    """Tabulate published numbers with ours."""
    main: Any = study.main
    g: Vector = main.resampled.acceleration
    paper = read_papers()["klioner2021"]
    rows: list[Any] = [("five-parameter sources", paper["sources"].value, np.nan, float(main.n_sources), np.nan)]
    magnitude = study.sources.field.magnitude
    if magnitude is not None:
        five = magnitude[~study.sources.six]
        rows += [
            (f"of them G ≤ {limit}", paper[f"sources, G ≤ {limit}"].value, np.nan, float((five <= limit).sum()), np.nan)
            for limit in (18, 19, 20)
        ]
    rows.append(("clipped, about", paper["clipped, about"].value, np.nan, float(main.n_clipped), np.nan))
    ours = [*zip(g.value, g.sigma, strict=True), (g.amplitude, g.amplitude_error)]
    ours += list(zip(g.direction, g.direction_error, strict=True))
    for name, (value, sigma) in zip(("g_x", "g_y", "g_z", "|g|", "ra", "dec"), ours, strict=True):
        rows.append((f"{name} [{paper[name].unit}]", paper[name].value, paper[name].error, value, sigma))
    names = ("number", "published", "error", "here", "error_here")
    return tables.table_of(dict(zip(names, zip(*rows, strict=True), strict=True)))


#: All that is written.
_FIGURES = ("acceleration_by_degree", "acceleration_by_subset", "powers", "density", "sky", "correlation", "residuals")
_HEADINGS = {
    "published": "Beside the paper",
    "degrees": "By the highest degree of the fit",
    "subsets": "By subsets of the sources",
    "powers": "Powers and p-values",
    "correlations": "Correlations of spin and acceleration",
}
FILES = {"report.md", _PAGE, *(f"{name}.ecsv" for name in _HEADINGS), *(f"{name}.png" for name in _FIGURES)}


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
        Truth of a simulated catalogue.
    provenance : dict, optional
        Plain values.
    figures : dict, optional
        As for `vsh.figures.plot.save_figures`: format and dpi; None for no files of figures.
    """
    matplotlib.use("agg")
    result_tables = {
        "published": published_table(study),
        "degrees": row_table(study.degrees, truth),
        "subsets": row_table(study.subsets, truth),
        "powers": power_table(study),
        "correlations": correlation_table(study),
    }
    for name, table in result_tables.items():
        tables.write_table(table, folder / f"{name}.ecsv")
    plots = draw(study, truth)
    if figures is not None:
        save_figures(plots, folder, **figures, close=False)
    text = _report(study, result_tables, truth)
    (folder / "report.md").write_text(text, encoding="utf-8")
    main: Any = study.main
    five = study.sources.field[~study.sources.six]
    write_html(
        main.resampled,
        five,
        folder / _PAGE,
        figures=plots,
        check=study.check,
        truth=None if truth is None else dict(truth),
        source=study.sources.label,
        provenance=dict(provenance or {}),
        title="The acceleration of the Solar System from Gaia's quasars",
        sections=[Section(_HEADINGS[name], (), table) for name, table in result_tables.items()],
        captions=CAPTIONS,
    )
    close_figures(plots.values())
    return text


def _report(study, result_tables, truth):
    main, g = study.main, study.main.resampled.acceleration
    lines = [
        "# The acceleration of the Solar System from Gaia's quasars",
        "",
        (
            f"{_with_floor(study.degrees, g)} By the bootstrap alone g = "
            f"({', '.join(f'{v:+.2f} ± {s:.2f}' for v, s in zip(g.value, g.sigma, strict=True))}) µas/yr: "
            f"{g.amplitude:.2f} ± {g.amplitude_error:.2f} µas/yr toward α = {g.direction[0]:.1f}° ± "
            f"{g.direction_error[0]:.1f}°, δ = {g.direction[1]:+.1f}° ± {g.direction_error[1]:.1f}°. "
            "vsh-referee sets other analyses beside it."
        ),
        "",
        (
            f"{study.sources.label}: {main.n_sources} five-parameter and {int(study.sources.six.sum())} six-parameter "
            f"sources. Fits of degree 3 to five-parameter sources, clipped at κ = 3 ({main.n_clipped} left out), "
            f"errors from {main.resampled.errors_from}, unless a table says otherwise. After Gaia Collaboration, "
            "Klioner et al. (2021, A&A 649, A9)."
        ),
    ]
    if truth:
        components = ", ".join(f"{v:+.3f}" for v in truth["acceleration"].value)
        draws = main.resampled.covariance_dof
        expected_chi2 = 6 * draws / (draws - 4)  # of three numbers with a covariance from so many draws, twice
        lines += [
            "",
            (
                f"A simulated catalogue; the truth is g = ({components}) µas/yr. The last column of the tables is χ² "
                f"of spin and g against it, {expected_chi2:.1f} ± {np.sqrt(12) * expected_chi2 / 6:.1f} where the "
                "errors "
                "are right."
            ),
        ]
    for name, table in result_tables.items():
        lines += ["", f"## {_HEADINGS[name]}", "", *_format_markdown(_format_table(name, table))]
    lines += [
        "",
        (
            "Thirds of colour are by the effective wavenumber, nu_eff_used_in_astrometry; halves of the sky are fitted "
            "to degree 1."
        ),
    ]
    failures = [row for row in (*study.degrees, *study.subsets) if row.solution is None]
    if failures:
        lines += ["", "## Without a result", "", *(f"* {row.name}: {row.said}" for row in failures)]
    notes = study.sources.field.notes
    lines += ["", "## Notes", "", *(f"* {note}" for note in notes)] if notes else []
    return "\n".join(lines) + "\n"


def _with_floor(degrees, g):
    """The first line: the acceleration with systematic errors, from the highest of the degrees up to 7."""
    solution: Any = next(row.solution for row in reversed(degrees[:_HIGHEST]) if row.solution is not None)
    try:
        systematic_floor = floor(solution)
    except VshError:
        return "**No number here includes systematic errors: there are too few sources to estimate them.**"
    acceleration = replace(g, covariance=g.covariance + systematic_floor.acceleration_error**2 * np.eye(3))
    lower, upper = systematic_floor.acceleration_interval
    components = ", ".join(f"{v:+.2f} ± {s:.2f}" for v, s in zip(acceleration.value, acceleration.sigma, strict=True))
    return (
        f"**g = ({components}) µas/yr** "
        f"with systematic errors, ± {systematic_floor.acceleration_error:.2f} µas/yr in each component ({lower:.2f} … "
        f"{upper:.2f}, 68 %) from the power of degrees 2 to {solution.modes.lmax}."
    )


def _format_table(name, table):
    """Columns that fit on a page; the files have all."""
    if name not in ("degrees", "subsets"):
        return table
    columns = [column for column in table.colnames if not (column.startswith("spin") or column.endswith("_formal"))]
    return table[columns]


def _format_markdown(table: Table) -> list[str]:
    lines = [
        "| " + " | ".join(name.replace("_", " ") for name in table.colnames) + " |",
        "|" + "---|" * len(table.colnames),
    ]
    for row in zip(*(table[name].tolist() for name in table.colnames), strict=True):
        lines.append("| " + " | ".join(cell(value).replace("|", "\\|") for value in row) + " |")
    return lines


def main(words: Sequence[str] | None = None) -> None:
    """Read a catalogue, fit all that the paper fits, and write it to a folder."""
    parser = argparse.ArgumentParser(description="The acceleration paper, Klioner et al. (2021), from one catalogue.")
    parser.add_argument("file", help="a file of vsh-archive gaia-crf3 or vsh-sim crf3")
    parser.add_argument("--output", required=True, type=Path, help="a new folder, or that of an earlier run")
    parser.add_argument("--lmax", type=int, default=10, help="the highest degree (%(default)s)")
    parser.add_argument("--n-bootstrap", type=int, default=500, help="draws of each fit (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap (%(default)s)")
    options = parser.parse_args(words)
    if options.output.exists() and not (options.output / _PAGE).exists():
        parser.error(f"{options.output} is there, and holds no earlier run: name another folder")
    others = {path.name for path in options.output.iterdir()} - FILES if options.output.exists() else ()
    if others:
        parser.error(
            f"{options.output} holds files of others ({min(others)}): it would be replaced, name another folder"
        )
    try:
        sources, truth = read_gaia(options.file), truth_of(options.file)
        study = run_gaia(sources, max_lmax=options.lmax, n_replicates=options.n_bootstrap, rng=options.seed)
    except VshError as error:
        parser.error(str(error))
    counts = {"rows_used": len(sources.field), "rows_refused": count_dropped(sources.field.notes)}
    meta = provenance(options.file, options, **counts)
    with atomic_folder(options.output) as folder:
        print(write_gaia(study, folder, truth=truth, provenance=meta, figures={}))


if __name__ == "__main__":
    main()
