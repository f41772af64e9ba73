"""`vsh-compare`: two catalogues of one sky, on the command line."""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fit
import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.io.quantities import latex_table, make_label
from vsh.io.sections import Answer, Section
from vsh.tools.errors import TableError
from vsh.tools.notes import merge_notes


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-compare",
        description=(
            "Match the sources of two catalogues and fit vector spherical harmonics to their differences, with both "
            "covariances: rotation, glide and deformation of one frame relative to the other, and a list of outliers. "
            "Three or more catalogues are also solved together."
        ),
        examples=(
            "vsh-compare icrf3sx.txt icrf2-all.txt --output comparison --html comparison.html",
            "vsh-compare one.fits two.fits three.fits",
            "vsh-compare one.fits two.fits --lmax 1 --parameters spin --method student",
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", f"ICRF2 or ICRF3 as the IERS distributes them, or {parsing.A_TABLE}")
    add("catalogue2", "the catalogue that is subtracted from the first")
    add(
        "others",
        "further catalogues: each is subtracted from the first, and all are combined in one solution",
        default=[],
        nargs="*",
        metavar="catalogue3",
    )
    add("--lmax", "highest degree of the fit", parsing.count(1), 2)
    add(
        "--what",
        "what is compared (default: motions where both have some, positions otherwise)",
        ("positions", "motions"),
    )
    add(
        "--match name|ARCSEC",
        "how sources are matched: by name (default), or by position within ARCSEC",
        _parse_matching,
        action=parsing.JoinValues,
    )
    add(
        "--crosswalk FILE",
        "identifiers of one release for those of another | for the second and all further catalogues (vsh-archive "
        "dr3-neighbourhood)",
    )
    add(
        "--parameters",
        "also fit the rotation or the glide alone | orientation of positions, spin of motions",
        ("degree", "orientation", "spin", "glide"),
        "degree",
    )
    add(
        "--method NAME[=VALUE]",
        "least-squares (default), student, excess-noise, bootstrap=N or jackknife; clip=X | least squares rescales "
        "errors in classes of sources with similar formal errors; clip=X beside another or alone: sources whose "
        "difference exceeds X standard errors are excluded and listed (5 unless given)",
        action=parsing.JoinValues,
    )
    add(
        "--floor",
        "solve with the systematic floor, estimated from degrees 2 to 5 of the differences, or not | yes is the "
        "default for 100000 sources or more; for fewer its size is added to the errors of rotation and glide if it can "
        "be estimated, unless no is given",
        ("yes", "no"),
        nargs="?",
        const="yes",
    )
    add("--where2 CONDITION", "rows to use of the second and all further catalogues (default: as --where)")
    reading.add_reading(parser)
    return parsing.add_common(parser)


def _parse_matching(text):
    """Parse how sources are matched: by what, and within which radius. [arcsec]"""
    if text in ("name", "position"):
        return {"by": text}
    return {"by": "position", "radius": parsing.parse_positive(text)}


#: Estimators of the differences, and the fewest replicates.
_METHODS, _MIN_REPLICATES = ("least-squares", "student", "excess-noise", "bootstrap", "jackknife"), 10


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with an estimator or a value that a comparison does not know."""
    options.threshold, methods = 5.0, (options.method or "least-squares").split(",")
    options.method = "least-squares"
    for method_text in methods:
        method, value = parsing.split_method(method_text)
        if method == "clip":
            try:
                options.threshold = parsing.parse_positive(value or "5")
            except argparse.ArgumentTypeError as error:
                parser.error(f"argument --method: {error}")
            continue
        options.method = method_text
        if method not in _METHODS:
            parser.error(f"--method of a comparison is clip or {', '.join(_METHODS)}, not {method}")
        if value is not None and method != "bootstrap":
            parser.error(f"--method {method} of a comparison takes no value")
        if value is not None and not (value.isdecimal() and int(value) >= _MIN_REPLICATES):
            parser.error(f"--method bootstrap takes {_MIN_REPLICATES} replicates at least, not {value}")
    options.match = {"by": "name"} | (options.match or {})


def _run(options):
    run = finishing.Run(options)
    paths = [options.catalogue, options.catalogue2, *options.others]
    quantity = options.what or ("motions" if all(_has_motions(path, options) for path in paths) else "positions")
    labels = _make_catalogue_labels(paths)
    reference = _read_one_catalogue(paths[0], quantity, options, options.where)
    results, fields = {}, {}
    method: Any
    method, method_value = parsing.split_method(options.method)
    for path, label in zip(paths[1:], labels[1:], strict=True):
        fields[label] = _read_one_catalogue(path, quantity, options, options.where2 or options.where)
        if options.crosswalk:
            fields[label] = vsh.io.catalogue.rename_sources(fields[label], options.crosswalk)
        results[label] = fit.compare.compare_catalogues(
            reference,
            fields[label],
            options.lmax,
            **options.match,
            threshold=options.threshold,
            labels=(labels[0], label),
            floor=_parse_floor_choice(options),
            parameters=options.parameters,
            method=method,
            replicates=int(method_value or 1000),
        )
    comparisons = [comparison for comparison, _ in results.values()]
    network = _combine_catalogues({labels[0]: reference} | fields, options) if len(results) > 1 else None

    def make_sections(long):
        report_sections = [section for comparison in comparisons for section in comparison.sections(long=long)]
        return report_sections if network is None else [*network.sections(long=long), *report_sections]

    def make_tables():
        tables = {} if network is None else {"All catalogues in one solution": network.to_table()}
        for label, (comparison, _) in results.items():
            title_suffix = f": {label}" if len(results) > 1 else ""
            tables[f"Under the names of the ICRF3 papers{title_suffix}"] = comparison.parameters_table()
            tables[f"Vectors{title_suffix}"] = fit.output.vectors_table(comparison.best)
            tables[f"Coefficients{title_suffix}"] = comparison.best.to_table()
            if comparison.shared is not None:
                tables[f"With systematic errors{title_suffix}"] = comparison.shared.to_table()
            if comparison.names:
                tables[f"Sources that were left out{title_suffix}"] = comparison.outliers_table()
        return tables

    answer_lines = [
        (f"{labels[0]} − {label}: {name}" if network is not None else name, text)
        for label, (comparison, _) in results.items()
        for name, text in comparison.answer.lines
        if network is None or name in ("deformation", "no comparison")
    ]
    if network is not None:  # one result to quote: that of all catalogues together, of each two of them
        prefixes = [name.removesuffix("no comparison") for name, _ in answer_lines if name.endswith("no comparison")]
        joint = [line for line in network.answer.lines if not line[0].startswith(tuple(prefixes))]
        answer_lines = [*joint, *answer_lines, ("errors", network.errors_in_words)]

    def format_latex():
        joint = [] if network is None else [latex_table(part.table, part.title) for part in network.sections()]
        return "\n\n".join([*joint, *map(_format_latex_tables, comparisons)])

    part = finishing.Part(
        "comparison",
        None,
        sections=make_sections,
        tables=make_tables,
        plot=lambda: (
            {
                f"{name}{_make_file_suffix(label, results)}": axes
                for label, (comparison, differences) in results.items()
                for name, axes in _draw_comparison_figures(comparison, differences).items()
            }
            | ({} if network is None else {"chain": network.plot()})
        ),
        files=lambda folder, meta: _write_result_files(folder, results, network, meta),
    )
    run.finish(
        [part],
        notes=merge_notes(
            *(comparison.solution.notes for comparison in comparisons), () if network is None else network.notes
        ),
        latex=format_latex,
        answer=Answer(tuple(answer_lines)),
        paths=paths,
        counts=_count_matches_and_outliers(list(results.values())),
        page=None if network is not None else partial(_write_html_page, *results[labels[1]], options),
        title=f"{labels[0]} beside {', '.join(labels[1:])}",
    )


def _parse_floor_choice(options):
    """The choice of the user to include the floor or not; None where the number of sources decides."""
    return None if options.floor is None else options.floor == "yes"


def _make_file_suffix(label, results):
    """Suffix of a file name where there are several catalogues."""
    return f"_{label}" if len(results) > 1 else ""


def _count_matches_and_outliers(comparisons_and_differences):
    match_counts = [len(differences) + len(comparison.names) for comparison, differences in comparisons_and_differences]
    outlier_counts = [len(comparison.names) for comparison, _ in comparisons_and_differences]
    counts = {"matched": match_counts, "left_out": outlier_counts}
    return counts if len(comparisons_and_differences) > 1 else {name: count for name, (count,) in counts.items()}


def _combine_catalogues(catalogues, options):
    """All catalogues in one solution with their common noise; by position, sources have the names of the first."""
    if options.match["by"] == "position":
        catalogues = _rename_by_position(catalogues, options.match.get("radius"))
    return fit.chain.combine_frames(catalogues, options.lmax, floor=_parse_floor_choice(options) is not False)


def _rename_by_position(catalogues, radius):
    """The catalogues with the numbers of the first one's sources for names, without what has no counterpart there."""
    (label, reference), *other_catalogues = catalogues.items()
    renamed = {label: replace(reference, name=range(len(reference)))}
    for label, catalogue in other_catalogues:
        i, j, _ = vsh.io.catalogue.counterparts(reference, catalogue, by="position", radius=radius)
        renamed[label] = replace(catalogue[j], name=i)
    return renamed


def _write_result_files(folder, results, network, meta):
    if network is not None:
        network.write(folder / "chain.ecsv", meta)
    for label, (comparison, _) in results.items():
        suffix = _make_file_suffix(label, results)
        comparison.write(folder / f"comparison{suffix}.ecsv", meta)
        comparison.best.write(folder / f"solution{suffix}.ecsv", meta)
        fit.output.write_correlation(comparison.best, folder / f"correlation{suffix}.ecsv", meta)
        if comparison.shared is not None:
            comparison.shared.write(folder / f"shared{suffix}.ecsv", meta)
        vsh.io.tables.write_table(comparison.parameters_table(), folder / f"parameters{suffix}.ecsv", meta)
        vsh.io.tables.write_table(comparison.outliers_table(), folder / f"outliers{suffix}.ecsv", meta)


def _format_latex_tables(comparison):
    """Format tables for a paper: parameters under their names with the errors of the verdict, then vectors and
    powers."""
    table = comparison.parameters_table()["ICRF3", "value", "sigma"]
    title = " − ".join(comparison.labels)
    vectors = fit.output.latex_of(comparison.best, answer=comparison.answer)
    vectors = vectors.replace("tab:vsh}", f"tab:vsh-{make_label(title)}}}")  # one for each pair
    return f"{latex_table(table, title)}\n\n{vectors}"


def _draw_comparison_figures(comparison, differences):
    figures = fit.output.draw_figures(comparison.best, differences) | {"catalogues": comparison.correlations.plot()}
    return figures if comparison.shared is None else figures | {"shared": comparison.shared.plot()}


def _write_html_page(comparison, differences, options, figures, meta, path):
    sections = [Section("Under the names of the ICRF3 papers", (), comparison.parameters_table())]
    if comparison.shared is not None:
        sections += comparison.shared.sections(long=True)
    if comparison.names:
        sections.append(Section("Sources that were left out", (), comparison.outliers_table()))
    captions = {
        "catalogues": "Correlations of the coefficients by the errors of either catalogue, one in each triangle.",
        "shared": "Rotation and glide with systematic errors.",
    }
    fit.output.write_html(
        comparison.best,
        differences,
        path,
        overwrite=True,
        command=options.command,
        source=" − ".join(comparison.labels),
        provenance=meta,
        answer=comparison.answer,
        figures=figures.axes_by_name,
        captions=captions,
        sections=sections,
    )


def _has_motions(path, options):
    try:
        names = vsh.io.tables.open_table(path, options.input_format).names
        if vsh.io.catalogue.has_epochs(names):
            return True
        columns, _ = vsh.io.catalogue.as_columns(options.columns).choose_names(names)
        return {columns.pmra, columns.pmdec} <= set(names)
    except TableError:  # ICRF's fixed columns, or columns of positions
        return False


def _read_one_catalogue(path, quantity, options, condition):
    return reading.read_with_named_notes(path, lambda: _read_catalogue(path, quantity, options, condition))


def _read_catalogue(path, quantity, options, condition):
    if quantity == "motions":
        arguments = reading.field_arguments(options) | {"where": condition, "sigma": options.sigma}
        return vsh.io.catalogue.read_field(path, roles=("name",), **arguments).to_frame(options.frame)
    positions = vsh.io.catalogue.read_positions(
        path,
        options.columns,
        units=options.units,
        sigma=options.sigma,
        on_bad=options.on_bad,
        frame=options.catalogue_frame,
        where=condition,
        format=options.input_format,
    )
    return positions.to_frame(options.frame)


def _make_catalogue_labels(paths):
    names = [Path(path).stem for path in paths]
    if len(set(names)) == len(names):
        return names
    if len(names) == 2:
        return [f"{names[0]} (first)", f"{names[1]} (second)"]
    return [f"{name} ({k})" for k, name in enumerate(names, 1)]


main, run = running.make_entry(__name__, _run)
