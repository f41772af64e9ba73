"""`vsh-fit`: from a catalogue to spin and acceleration, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import fit
import vsh
from fit.commands import background_options
from vsh.checks.notes import dropped, unselected
from vsh.commands import figures, outputs, parsing, parts_options, reading, running

DEMO = "demo.fits"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-fit`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if bool(options.catalogue) == options.demo:
        parser.error("name one catalogue, or say --demo")
    if options.beside and not options.html:
        parser.error("--beside is for the page: name it, --html FILE")
    return running.guarded("vsh-fit", lambda: _run(options), options.threads)


def _run(options):
    outputs.check(options, "vsh-fit")
    path = files("fit") / DEMO if options.demo else options.catalogue
    # Not before: --help should not wait for astropy.
    from vsh import catalogue, tables

    source = tables.open_table(str(path))
    if parts_options.in_parts(options):
        whole = catalogue.parts(str(path), **parts_options.reading_parts(options))
    else:  # names tell of sources that stand there twice, and are in the report; no fit looks at the rest
        whole = catalogue.read_field(source, **reading.arguments(options), roles=("name",))
    field = whole.to_frame(options.frame)
    solution, kept, clipped = _fit(field, vsh.Modes(options.lmax), options)
    backgrounds = background_options.found(solution, options)
    solution = backgrounds.solution
    name = "the simulated catalogue of the demo" if options.demo else str(path)
    check, truth = fit.cross_check(kept), catalogue.truth_of(source)
    text = "\n".join([fit.report(solution, check=check, truth=truth, source=name), *backgrounds.texts])
    running.say(text)
    if not (options.output or options.html):
        return
    refused, out, used = dropped(solution.notes), unselected(solution.notes), solution.n_sources
    counts = {
        "rows": used + clipped + refused + out,
        "rows_used": used,
        "rows_refused": refused,
        "rows_clipped": clipped,
    }
    counts |= {"rows_not_selected": out} if options.where else {}
    meta = running.provenance(path, options, {"vsh-astrometry": vsh.__version__}, **counts)
    drawn = figures.Figures(lambda: fit.output.draw_figures(solution, kept) | backgrounds.draw())
    if options.output:
        with outputs.results_folder(options.output, "vsh-fit", meta, options.overwrite) as folder:
            (folder / "report.txt").write_text(text, encoding="utf-8")
            solution.write(folder / "solution.ecsv", meta)
            fit.output.write_correlation(solution, folder / "correlation.ecsv", meta)
            backgrounds.write(folder, meta)
            drawn.write(folder, options)
            listed = [x.name for x in folder.iterdir()]
        running.say(running.written(options.output, listed))
    if options.html:
        about = {"check": check, "truth": truth, "source": Path(name).name, "provenance": meta}
        beside = (
            {"plain least squares, all sources": (fit.fit_field(field, options.lmax), field)} if options.beside else {}
        )
        fit.output.write_html(
            solution, kept, options.html, figures=drawn.drawn, command=options.command, captions=backgrounds.captions, beside=beside, **about
        )  # fmt: skip
        drawn.close()
        figures.say_page(options.html)


def _fit(field, modes, options):
    """The solution that was asked for, the sources that went into it, and how many were clipped."""
    solution, chosen, lost = None, 1.0, 0
    if options.clip is not None or options.clip_threshold is not None:
        clipped = fit.robust.clip(field, modes, options.clip, options.clip_threshold)
        solution, lost = clipped.solution, clipped.n_clipped
        field, chosen = clipped.sources(field), clipped.scatter_factor
    if options.excess_noise:
        solution = fit.robust.excess_noise(field, modes, scale=options.excess_noise == "scale").solution
    elif options.robust:
        method = {"student": fit.robust.student_t, "permissive": fit.robust.permissive}[options.robust]
        solution = method(field, modes).solution
    elif options.bootstrap:
        solution = fit.resample.bootstrap(field, modes, options.bootstrap, options.seed).resampled_solution
    elif options.jackknife == 0:
        _, best, advice = fit.resample.compare_blocks(field, modes)
        solution = best.resampled.resampled_solution
        solution = replace(solution, notes=(*solution.notes, advice))
    elif options.jackknife:
        solution = fit.resample.jackknife(field, modes, options.jackknife).resampled_solution
    elif solution is None:
        return fit.fit_field(field, modes), field, lost
    else:
        return solution, field, lost
    return replace(solution, covariance=solution.covariance * chosen), field, lost


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-fit",
        description="Fit vector spherical harmonics to a catalogue of proper motions: the spin of its frame, the "
        "acceleration of the Solar System, and the power of every degree.",
        epilog="Example: vsh-fit catalogue.fits --lmax 3 --clip 3 --frame galactic --output results",
    )
    parser.add_argument("catalogue", nargs="?", help="FITS, VOTable, ECSV, CSV or Parquet file, or a folder of them")
    parser.add_argument("--demo", action="store_true", help="run on a simulated catalogue that comes with the package")
    parser.add_argument("--lmax", type=_degree, default=3, help="highest degree (default: 3)")
    clips = parser.add_mutually_exclusive_group()
    clips.add_argument(
        "--clip",
        type=parsing.positive,
        metavar="KAPPA",
        help="leave out sources farther from the fit than KAPPA medians",
    )
    clips.add_argument(
        "--clip-threshold", type=parsing.positive, metavar="X", help="leave out sources farther than X, in errors"
    )
    errors = parser.add_mutually_exclusive_group()
    errors.add_argument(
        "--robust", choices=["student", "permissive"], help="robust likelihood, for catalogues with some wrong errors"
    )
    errors.add_argument(
        "--excess-noise",
        nargs="?",
        const="add",
        choices=["add", "scale"],
        help="add a variance to every source, by maximum likelihood; with 'scale', a factor on its errors too",
    )
    errors.add_argument("--bootstrap", type=parsing.count(2), metavar="N", help="errors from N draws of the sources")
    errors.add_argument(
        "--jackknife", type=parsing.nside, nargs="?", const=0, metavar="NSIDE",
        help="errors from leaving out HEALPix blocks; without NSIDE several sizes are compared and the report says which is "
        "long enough",
    )  # fmt: skip
    background_options.add(parser)
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap (default: 1)")
    parsing.add_threads(parser)
    parts_options.add_workers(parser)
    reading.add_reading(parser)
    parser.add_argument(
        "--beside",
        action="store_true",
        help="on the page of --html: plain least squares of all sources beside this fit",
    )
    parser.add_argument("--version", action="version", version=f"vsh-fit {vsh.__version__}")
    return parser


def _degree(text):
    try:
        return vsh.Modes(int(text)).lmax
    except ValueError:
        raise argparse.ArgumentTypeError(f"a whole number of at least 1 is wanted, not {text!r}") from None


if __name__ == "__main__":
    sys.exit(main())
