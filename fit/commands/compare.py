"""`vsh-compare`: two catalogues of one sky, on the command line."""

from pathlib import Path

from vsh.commands import finishing, outputs, reading, running
from vsh.commands.options import compare as options_module
from vsh.tools.errors import TableError, VshError


def _run(options):
    outputs.check(options)
    from fit.compare import compare_catalogues

    paths = [options.catalogue, options.catalogue2]
    what = options.what or ("motions" if all(_has_motions(path, options) for path in paths) else "positions")
    conditions = options.where, options.where2 or options.where
    one, two = (_read(path, what, options, where) for path, where in zip(paths, conditions, strict=True))
    labels = _labels(paths)
    comparison, kept = compare_catalogues(
        one, two, options.lmax, by=options.by, radius=options.radius, threshold=options.threshold, labels=labels
    )

    def sheets():
        tables = {
            "Under the names of the ICRF3 papers": comparison.parameters_table(),
            "Coefficients": comparison.solution.to_table(),
        }
        return tables | ({"Sources that were left out": comparison.outliers_table()} if comparison.names else {})

    finishing.finish(
        options,
        finishing.RunResult(comparison.report(), sheets, comparison.solution.notes, comparison.solution.latex),
        provenance=lambda: running.provenance(
            paths, options, matched=len(kept) + len(comparison.names), left_out=len(comparison.names)
        ),
        draw=lambda: _draw(comparison, kept),
        write=lambda folder, meta: _write(folder, comparison, meta),
        page=lambda drawn, meta: _page(comparison, kept, options, meta, drawn),
    )


def _write(folder, comparison, meta):
    from fit.output import write_correlation
    from vsh.io import tables

    comparison.write(folder / "comparison.ecsv", meta)
    comparison.solution.write(folder / "solution.ecsv", meta)
    write_correlation(comparison.solution, folder / "correlation.ecsv", meta)
    tables.write_table(comparison.parameters_table(), folder / "parameters.ecsv", meta)
    tables.write_table(comparison.outliers_table(), folder / "outliers.ecsv", meta)


def _draw(comparison, kept):
    from fit.output import draw_figures

    return draw_figures(comparison.solution, kept) | {"catalogues": comparison.correlations.plot()}


def _page(comparison, kept, options, meta, drawn):
    from fit.output import write_html

    left_out = {"Sources that were left out": comparison.outliers_table()} if comparison.names else {}
    captions = {
        "catalogues": "Correlations of the coefficients by the errors of either catalogue, one in each triangle."
    }
    write_html(
        comparison.solution,
        kept,
        options.html,
        command=options.command,
        source=" − ".join(comparison.labels),
        provenance=meta,
        figures=drawn.drawn,
        captions=captions,
        sections={"Under the names of the ICRF3 papers": comparison.parameters_table()} | left_out,
    )


def _has_motions(path, options):
    from vsh.io import catalogue, tables

    try:
        names = tables.open_table(path, options.input_format).names
        wanted, _ = catalogue.as_columns(options.columns).among(names)
        return {wanted.pmra, wanted.pmdec} <= set(names)
    except TableError:  # ICRF's fixed columns, or columns of positions
        return False


def _read(path, what, options, where):
    from vsh.io.catalogue import read_field, read_positions

    if what == "motions":
        given = reading.arguments(options) | {"where": where}
        return read_field(path, roles=("name",), **given).to_frame(options.frame)
    if options.frame != (options.catalogue_frame or "icrs"):
        raise VshError(f"positions are compared in the axes they are given in: leave out --frame {options.frame}")
    return read_positions(
        path,
        options.columns,
        sigma=options.position_error,
        on_bad=options.on_bad,
        frame=options.catalogue_frame or "icrs",
        where=where,
        format=options.input_format,
    )


def _labels(paths):
    names = [Path(path).stem for path in paths]
    return names if names[0] != names[1] else [f"{names[0]} (first)", f"{names[1]} (second)"]


main, run = running.make_entry(options_module, _run)
