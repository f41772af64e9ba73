"""`vsh-study`: a simulation study from a TOML file, on the command line."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import vsh
from vsh.checks.notes import dropped
from vsh.commands import figures, outputs, parsing, reading, running

_CAPTIONS = {
    "calibration": "Mean less truth, scatter over formal errors, and how often intervals of 68 and 95 % hold the truth, each with "
    "the error that the number of realisations leaves."
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-study`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if bool(options.configuration) + options.paper + bool(options.gaia) != 1:
        parser.error("name a configuration, or say --paper, or --gaia FILE")
    return running.guarded("vsh-study", lambda: _gaia(options) if options.gaia else _run(options), options.threads)


def _gaia(options):
    outputs.check(options, "vsh-study")
    # Not before: --help should not wait for astropy.
    from study.gaia import read_gaia, run_gaia, write_gaia
    from vsh.catalogue import truth_of

    sources, truth = read_gaia(options.gaia), truth_of(options.gaia)
    study = run_gaia(sources, max_lmax=options.lmax, n_replicates=options.n_bootstrap, rng=options.seed)
    counts = {"rows_used": len(sources.field), "rows_refused": dropped(sources.field.notes)}
    meta = running.provenance(options.gaia, options, {"vsh-astrometry": vsh.__version__}, **counts)
    with outputs.results_folder(options.output, "vsh-study", meta, options.overwrite) as folder:
        drawn = None if options.no_figures else {"format": options.format, "dpi": options.dpi}
        text = write_gaia(study, folder, truth=truth, provenance=meta, figures=drawn)
        listed = [x.name for x in folder.iterdir()]
    running.say(text)
    running.say(running.written(options.output, listed))
    if options.html:
        shutil.copyfile(Path(options.output) / "gaia.html", options.html)
        figures.say_page(options.html)


def _run(options):
    if options.html:
        outputs.check_file(options.html, options.overwrite, "--html")
    # Not before: --help should not wait for astropy.
    from study.config import load
    from study.results import read_realisations, summary, table_of
    from study.run import run

    study = load(files("study") / "paper.toml" if options.paper else options.configuration)
    count = options.n_realisations or study.n_realisations
    folder = run(study, options.output, n_realisations=count, workers=options.workers)
    if options.paper:
        from study.paper import write_paper

        write_paper(study, folder, count, draw=not options.no_figures)
    rows = summary(study, read_realisations(study, Path(folder), count))
    drawn = figures.Figures(lambda: _draw(rows))
    drawn.write(folder, options)
    running.say((folder / "tables.md").read_text(encoding="utf-8") if options.paper else _text(study, rows))
    running.say(running.written(folder, [x.name for x in Path(folder).iterdir() if x.is_file()]))
    if options.html:
        meta = running.provenance([], options, {"vsh-astrometry": vsh.__version__})
        figures.write_page(
            options.html, f"A simulation study: {study.settings['name']}", _text(study, rows), drawn, captions=_CAPTIONS,
            sheets={"Truth, mean, scatter, errors, coverage": table_of(rows)}, provenance=meta, command=options.command,
            lead=f"{count} realisations of each case, {study.settings['frame']} axes",
        )  # fmt: skip


def _draw(rows):
    from study.calibration import plot_calibration

    return {"calibration": plot_calibration(rows)}


def _text(study, rows):
    width = max(6, *(len(case["name"]) + 2 for case in study.cases))
    lines = [
        f"{'case':{width}}{'parameter':14}{'truth':>10}{'mean':>12}{'scatter':>12}{'formal σ':>12}{'off/s.e.':>10}{'68 %':>7}{'95 %':>7}"
    ]
    for row in rows:
        lines.append(
            f"{row['case']:{width}}{row['parameter']:14}{row['truth']:10.3f}{row['mean']:12.4f}{row['std']:12.4f}{row['sigma']:12.4f}"
            f"{row['off']:+10.2f}{100 * row['within_68']:6.0f}%{100 * row['within_95']:6.0f}%"
        )
    return "\n".join(lines)


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-study",
        description="Simulate many skies with a known truth, fit each, and compare: a TOML file in, a folder of results out. "
        "An interrupted study resumes where it stopped.",
        epilog="Example: vsh-study study.toml --output results; vsh-study --paper --output paper --n-realisations 5; "
        "vsh-study --gaia crf3.fits --output gaia",
    )
    parser.add_argument("configuration", nargs="?", help="a TOML file (docs/study.md)")
    parser.add_argument("--paper", action="store_true", help="the four cases of Bachchan, Hobbs & Lindegren (2016)")
    parser.add_argument(
        "--gaia", metavar="FILE", help="the acceleration paper of Gaia Collaboration, Klioner et al. (2021), from a file of "
        "vsh-archive gaia-crf3 or vsh-sim crf3",
    )  # fmt: skip
    parser.add_argument("--output", required=True, metavar="DIR", help="a new folder, or that of the same study")
    parser.add_argument("--n-realisations", type=parsing.count(1), metavar="N", help="in place of the configuration's")
    parser.add_argument("--workers", type=parsing.count(1), metavar="N", help="processes; one a core unless given")
    parser.add_argument("--lmax", type=parsing.count(3), default=10, help="--gaia: the highest degree (default: 10)")
    parser.add_argument(
        "--n-bootstrap",
        type=parsing.count(10),
        default=500,
        metavar="N",
        help="--gaia: draws of each fit (default: 500)",
    )
    parser.add_argument("--seed", type=int, default=1, help="--gaia: of the bootstrap (default: 1)")
    parsing.add_threads(parser)
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parser.add_argument("--version", action="version", version=f"vsh-study {vsh.__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
