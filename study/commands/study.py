"""`vsh-study`: a simulation study from a TOML file, on the command line."""

import argparse
from functools import partial
from pathlib import Path

from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Answer, Section
from vsh.tools.files import atomic_write


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
            "vsh-study study.toml --output results --n-realisations 20 --html study.html",
        ),
    )
    add = parsing.adder(parser)
    add("configuration", "a TOML file (docs/study.md)")
    add("--output DIR", "a new folder, or that of the same study", required=True)
    add("--n-realisations N", "in place of the configuration's", parsing.count(1))
    add("--workers N", "processes; one a core unless given", parsing.count(1))
    parsing.add_threads(parser)
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


#: How many parameters a short report lists.
_LISTED = 15
_CAPTIONS = {
    "calibration": (
        "Mean less truth, scatter over formal errors, and the coverage of 68 and 95 % intervals, each with "
        "the error that the number of realisations leaves."
    )
}


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
    with atomic_write(folder / parsing.NAME, overwrite=True) as target:
        target.write_text(finishing.repeats(options), encoding="utf-8")
    result = finishing.RunResult(
        partial(_sections, rows),
        lambda: {"Truth, mean, scatter, errors, coverage": table_of(rows)},
        answer=Answer(tuple(_answer(rows, count))),
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
            overwrite=options.overwrite,
        )
        finishing.print_line(options, f"written to {options.html}")


#: With fewer realisations the coverage of an interval is known to five per cent at best.
_MANY = 100


def _answer(rows, count):
    """Name the 68 % intervals that have their coverage within three errors, and those that have not."""
    wrong = [row for row in rows if abs(row["within_68"] - 0.6827) > 3 * max(row["within_68_error"], 1e-9)]
    if not wrong and count < _MANY:
        limit = 300 * (0.6827 * 0.3173 / count) ** 0.5
        text = f"{count} realisations show no fault of the coverage of 68 % intervals larger than ± {limit:.0f} %"
        return [("coverage", f"{text}; {_MANY} and more tell something")]
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


main, run = running.make_entry(__name__, _run)
