"""`vsh-compare`: two catalogues of one sky, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import vsh
from vsh.commands import figures, outputs, parsing, reading, running
from vsh.errors import TableError, VshError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-compare`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    options = parsing.parse(make_parser(), arguments)
    return running.guarded("vsh-compare", lambda: _run(options), options.threads)


def _run(options):
    outputs.check(options, "vsh-compare")
    # Not before: --help should not wait for astropy.
    from fit.compare import compare

    paths = [options.catalogue, options.catalogue2]
    what = options.what or ("motions" if all(map(_has_motions, paths)) else "positions")
    one, two = (_read(path, what, options) for path in paths)
    labels = _labels(paths)
    found, kept = compare(
        one, two, options.lmax, by=options.by, radius=options.radius, threshold=options.threshold, labels=labels
    )
    text = found.report()
    running.say(text)
    if not (options.output or options.html):
        return
    meta = running.provenance(
        paths,
        options,
        {"vsh-astrometry": vsh.__version__},
        matched=len(kept) + len(found.names),
        left_out=len(found.names),
    )
    drawn = figures.Figures(lambda: _draw(found, kept))
    if options.output:
        with outputs.results_folder(options.output, "vsh-compare", meta, options.overwrite) as folder:
            _write(folder, text, found, meta)
            drawn.write(folder, options)
            listed = [x.name for x in folder.iterdir()]
        running.say(running.written(options.output, listed))
    if options.html:
        _page(found, kept, options, meta, drawn)
        drawn.close()
        figures.say_page(options.html)


def _write(folder, text, found, meta):
    from fit.output import write_correlation
    from vsh import tables

    (folder / "report.txt").write_text(text, encoding="utf-8")
    found.write(folder / "comparison.ecsv", meta)
    found.solution.write(folder / "solution.ecsv", meta)
    write_correlation(found.solution, folder / "correlation.ecsv", meta)
    tables.write_table(found.parameters_table(), folder / "parameters.ecsv", meta)
    tables.write_table(found.outliers_table(), folder / "outliers.ecsv", meta)


def _draw(found, kept):
    from fit.output import draw_figures

    return draw_figures(found.solution, kept) | {"catalogues": found.correlations.plot()}


def _page(found, kept, options, meta, drawn):
    from fit.output import write_html

    left_out = {"Sources that were left out": found.outliers_table()} if found.names else {}
    captions = {
        "catalogues": "Correlations of the coefficients by the errors of either catalogue, one in each triangle."
    }
    write_html(
        found.solution, kept, options.html, command=options.command, source=" − ".join(found.labels), provenance=meta,
        figures=drawn.drawn, captions=captions,
        sections={"Under the names of the ICRF3 papers": found.parameters_table()} | left_out,
    )  # fmt: skip


def _has_motions(path):
    from vsh import tables

    try:
        names = tables.open_table(path).names
    except TableError:  # ICRF's fixed columns
        return False
    return {"pmra", "pmdec"} <= set(names)


def _read(path, what, options):
    from vsh.catalogue import read_field, read_positions

    if what == "motions":
        return read_field(path, roles=("name",), **reading.arguments(options)).to_frame(options.frame)  # fmt: skip
    if options.frame != (options.catalogue_frame or "icrs"):
        raise VshError(f"positions are compared in the axes they are given in: leave out --frame {options.frame}")
    return read_positions(
        path,
        options.columns,
        sigma=options.position_error,
        on_bad=options.on_bad,
        frame=options.catalogue_frame or "icrs",
        where=options.where,
    )


def _labels(paths):
    names = [Path(path).stem for path in paths]
    return names if names[0] != names[1] else [f"{names[0]} (first)", f"{names[1]} (second)"]


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-compare",
        description="Match two catalogues of one sky and fit their differences, with both covariances: how one frame is turned "
        "against the other, drifts and is deformed, and which sources do not fit.",
        epilog="Example: vsh-compare icrf3sx.txt icrf2-all.txt --lmax 2 --output comparison --html comparison.html",
    )
    parser.add_argument(
        "catalogue", help="ICRF2 or ICRF3 as the IERS hands them round, or FITS, VOTable, ECSV, CSV, Parquet"
    )
    parser.add_argument("catalogue2", help="the one that is subtracted")
    parser.add_argument("--lmax", type=parsing.count(1), default=2, help="highest degree of the fit (default: 2)")
    parser.add_argument(
        "--what", choices=["positions", "motions"],
        help="what is compared (default: motions where both have some, positions otherwise)",
    )  # fmt: skip
    parser.add_argument(
        "--by", choices=["name", "position"], default="name", help="how sources are matched (default: name)"
    )
    parser.add_argument(
        "--radius", type=parsing.positive, metavar="ARCSEC", help="of a match by position, arcsec (default: 1)"
    )
    parser.add_argument(
        "--threshold", type=parsing.positive, default=5.0, metavar="X",
        help="differences beyond so many errors are left out and listed (default: 5)",
    )  # fmt: skip
    parser.add_argument(
        "--position-error", type=parsing.positive, metavar="UAS", help="one error for all positions, µas"
    )
    parsing.add_threads(parser)
    reading.add_reading(parser)
    parser.add_argument("--version", action="version", version=f"vsh-compare {vsh.__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
