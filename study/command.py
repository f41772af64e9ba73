"""`vsh-study`: a simulation study from a TOML file, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import vsh
from vsh.commands import parsing, running


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-study`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if bool(options.configuration) == options.paper:
        parser.error("name a configuration, or say --paper")
    return running.guarded("vsh-study", lambda: _run(options))


def _run(options):
    # Not before: --help should not wait for astropy.
    from study import load, run

    study = load(files("study") / "paper.toml" if options.paper else options.configuration)
    count = options.n_realisations or study.n_realisations
    folder = run(study, options.output, n_realisations=count, workers=options.workers)
    if options.paper:
        from study.paper import write_paper

        write_paper(study, folder, count)
    running.say((folder / "tables.md").read_text(encoding="utf-8") if options.paper else _text(study, folder, count))
    running.say(running.written(folder, [x.name for x in Path(folder).iterdir() if x.is_file()]))


def _text(study, folder, count):
    from study.results import read_realisations, summary

    width = max(6, *(len(case["name"]) + 2 for case in study.cases))
    lines = [
        f"{'case':{width}}{'parameter':14}{'truth':>10}{'mean':>12}{'scatter':>12}{'formal σ':>12}{'off/s.e.':>10}"
    ]
    for row in summary(study, read_realisations(study, Path(folder), count)):
        lines.append(
            f"{row['case']:{width}}{row['parameter']:14}{row['truth']:10.3f}{row['mean']:12.4f}{row['std']:12.4f}{row['sigma']:12.4f}"
            f"{row['off']:+10.2f}"
        )
    return "\n".join(lines)


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-study",
        description="Simulate many skies with a known truth, fit each, and compare: a TOML file in, a folder of results out. "
        "An interrupted study resumes where it stopped.",
        epilog="Example: vsh-study study.toml --output results; vsh-study --paper --output paper --n-realisations 5",
    )
    parser.add_argument("configuration", nargs="?", help="a TOML file (docs/study.md)")
    parser.add_argument("--paper", action="store_true", help="the four cases of Bachchan, Hobbs & Lindegren (2016)")
    parser.add_argument("--output", required=True, metavar="DIR", help="a new folder, or that of the same study")
    parser.add_argument("--n-realisations", type=parsing.count(1), metavar="N", help="in place of the configuration's")
    parser.add_argument("--workers", type=parsing.count(1), metavar="N", help="processes; one a core unless given")
    parser.add_argument("--version", action="version", version=f"vsh-study {vsh.__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
