"""`vsh-study`: a simulation study from a TOML file, on the command line."""

import argparse
import shutil
from functools import partial
from pathlib import Path

import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Answer, Section
from vsh.tools.files import atomic_write
from vsh.tools.notes import dropped


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-study",
        description=(
            "Simulate many skies with a known truth, fit each, and compare: a TOML file in, a folder of results out. "
            "An interrupted study resumes where it stopped."
        ),
        examples=(
            "vsh-study study.toml --output results",
            "vsh-study study.toml --output results --workers 2",
            "vsh-study --gaia crf3.fits --output gaia",
        ),
    )
    add = parsing.adder(parser)
    add("configuration", "a TOML file (docs/study.md)", nargs="?")
    add(
        "--gaia FILE",
        "the acceleration paper of Gaia Collaboration, Klioner et al. (2021), from a file of vsh-archive gaia-crf3 or "
        "vsh-sim crf3",
    )
    add("--output DIR", "a new folder, or that of the same study", required=True)
    add("--n-realisations N", "in place of the configuration's", parsing.count(1))
    add("--workers N", "processes; one a core unless given", parsing.count(1))
    add("--lmax", "--gaia: the highest degree", parsing.count(3), 10)
    add("--n-bootstrap N", "--gaia: draws of each fit", parsing.count(10), 500)
    add("--seed", "--gaia: of the bootstrap", int, 1)
    parsing.add_threads(parser)
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.configuration) + bool(options.gaia) != 1:
        parser.error("name a configuration, or --gaia FILE")


#: How many parameters a short report lists.
_LISTED = 15
_CAPTIONS = {
    "calibration": (
        "Mean less truth, scatter over formal errors, and the coverage of 68 and 95 % intervals, each with "
        "the error that the number of realisations leaves."
    )
}


def _act(options):
    return _gaia(options) if options.gaia else _run(options)


def _gaia(options):
    finishing.check(options)
    from study.gaia import read_gaia, run_gaia, write_gaia
    from vsh.io.catalogue import truth_of

    sources, truth = read_gaia(options.gaia), truth_of(options.gaia)
    study = run_gaia(sources, max_lmax=options.lmax, n_replicates=options.n_bootstrap, rng=options.seed)
    counts = {"rows_used": len(sources.field), "rows_refused": dropped(sources.field.notes)}
    meta = running.provenance(options.gaia, options, **counts)
    with finishing.results_folder(options, meta) as folder:
        formats = parsing.figure_formats(options.format)
        figure_options = None if options.no_figures else {"format": formats, "dpi": options.dpi}
        text = write_gaia(study, folder, truth=truth, provenance=meta, figures=figure_options)
    paths = sorted(Path(options.output).glob("*.ecsv"))
    finishing.print_result(
        options,
        finishing.message(
            text, lambda: {path.stem: vsh.io.tables.read_table(path) for path in paths}, sources.field.notes
        ),
    )
    finishing.print_line(options, running.written(options.output, (x.name for x in Path(options.output).iterdir())))
    if options.html:
        with atomic_write(options.html) as target:
            shutil.copyfile(Path(options.output) / "gaia.html", target)
        finishing.print_line(options, finishing.of_page(options.html))


def _run(options):
    if options.html:
        finishing.check_file(options.html, options.overwrite, "--html")
    from study.config import load
    from study.run import read_realisations, run, summary, table_of

    study = load(options.configuration)
    count = options.n_realisations or study.n_realisations
    folder = run(study, options.output, n_realisations=count, workers=options.workers)
    rows = summary(study, read_realisations(study, Path(folder), count))
    figures = finishing.Figures(lambda: _draw(rows))
    figures.write(folder, options)
    with atomic_write(folder / parsing.NAME) as target:
        target.write_text(finishing.repeats(options), encoding="utf-8")
    result = finishing.RunResult(
        partial(_sections, rows),
        lambda: {"Truth, mean, scatter, errors, coverage": table_of(rows)},
        answer=Answer(tuple(_answer(rows))),
    )
    finishing.print_result(options, result)
    finishing.print_line(options, running.written(folder, [x.name for x in Path(folder).iterdir() if x.is_file()]))
    if options.html:
        finishing.write_page(
            options.html,
            f"A simulation study: {study.settings['name']}",
            _sections(rows, True),
            figures,
            captions=_CAPTIONS,
            provenance=running.provenance([], options),
            command=options.command,
            answer=result.answer,
            lead=f"{count} realisations of each case, {study.settings['frame']} axes",
        )
        finishing.print_line(options, f"written to {options.html}")


def _answer(rows):
    """Name the 68 % intervals that have their coverage within three errors, and those that have not."""
    wrong = [row for row in rows if abs(row["within_68"] - 0.6827) > 3 * max(row["within_68_error"], 1e-9)]
    if not wrong:
        return [("coverage", f"68 % intervals of all {len(rows)} parameters cover as they should")]
    worst = max(wrong, key=lambda row: abs(row["within_68"] - 0.6827))
    examples = ", ".join(f"{row['parameter']} of {row['case']}" for row in wrong[:6])
    suffix = f" and {len(wrong) - 6} more" if len(wrong) > 6 else ""
    right = f"68 % intervals of {len(rows) - len(wrong)} of {len(rows)} parameters cover as they should"
    sentence = f"{right}; not of {examples}{suffix}"
    return [
        ("coverage", f"{sentence} (worst: {worst['parameter']} of {worst['case']}, {100 * worst['within_68']:.0f} %)")
    ]


def _draw(rows):
    from study.run import plot_calibration

    return {"calibration": plot_calibration(rows)}


def _sections(rows, long):
    """Truth, mean and coverage of every parameter; short, of those that are farthest from their coverage."""
    from study.run import table_of

    order = sorted(range(len(rows)), key=lambda k: -abs(rows[k]["within_68"] - 0.6827))[:_LISTED]
    names = ("case", "parameter", "truth", "mean", "std", "sigma", "off", "within_68", "within_95")
    forms = dict.fromkeys(("truth", "mean", "std", "sigma"), ".4f") | {"off": "+.2f"}
    forms |= dict.fromkeys(("within_68", "within_95"), ".2f")
    indices = None if long or len(rows) <= _LISTED else order
    remarks = [f"The {_LISTED} of {len(rows)} parameters that are farthest from 68 %."] if indices else []
    return [Section("Truth, mean, scatter, errors, coverage", (), table_of(rows), names, indices, forms, remarks)]


main, run = running.make_entry(__name__, _act)
