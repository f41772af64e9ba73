"""`vsh-forecast`: what catalogues to come will tell, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import vsh
from vsh.commands import figures, outputs, parsing, reading, running
from vsh.errors import VshError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-forecast`; returns the exit status: 0, 1 or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    options = parsing.parse(make_parser(), arguments)
    return running.guarded("vsh-forecast", lambda: _run(options))


def _run(options):
    outputs.check(options, "vsh-forecast")
    # Not before: --help should not wait for what computes.
    from study.forecast import SURVEYS, Survey, forecast

    surveys = dict(SURVEYS)
    for name in options.only or ():
        if name not in surveys:
            raise VshError(f"no survey is called {name!r}: {', '.join(surveys)} are")
    surveys = {name: surveys[name] for name in options.only or surveys}
    for name, (n, sigma) in (options.survey or {}).items():
        surveys[name] = Survey(n, sigma=sigma, says="as given")
    found = forecast(surveys, sky=options.sky, flows=not options.no_flows)
    running.say(found.report())
    if not (options.output or options.html):
        return
    meta = running.provenance([], options, {"vsh-astrometry": vsh.__version__})
    drawn = figures.Figures(lambda: {"forecast": found.plot()})
    if options.output:
        with outputs.results_folder(options.output, "vsh-forecast", meta, options.overwrite) as folder:
            _write(folder, found, meta)
            drawn.write(folder, options)
            listed = [x.name for x in folder.iterdir()]
        running.say(running.written(options.output, listed))
    if options.html:
        sheets = {"Errors to come": found.to_table()}
        title = "What catalogues to come will tell"
        figures.write_page(
            options.html, title, found.report(), drawn, sheets=sheets, provenance=meta, command=options.command
        )


def _write(folder, found, meta):
    from vsh import tables

    (folder / "report.txt").write_text(found.report(), encoding="utf-8")
    tables.write_table(found.to_table(), folder / "forecast.ecsv", meta)


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-forecast",
        description="Errors to come of spin, acceleration, R0, gravitational waves, shear, our velocity and H0: for Gaia DR3, "
        "DR4, DR5, a successor in the near infrared, VLBI, and surveys of one's own.",
        epilog="Example: vsh-forecast --only 'Gaia DR4' --survey mine=5000,3.0 --output forecast",
    )
    parser.add_argument("--only", type=_names, metavar="NAME,…", help="some of the surveys that are known")
    parser.add_argument(
        "--survey", type=_surveys, metavar="NAME=N,SIGMA",
        help="one of your own: so many quasars with this error, µas/yr",
    )  # fmt: skip
    parser.add_argument(
        "--sky", choices=["even", "gums", "igql"], default="even",
        help="of the quasars: even, behind no Galactic plane, or as in the list of known ones (default: even)",
    )  # fmt: skip
    parser.add_argument("--no-flows", action="store_true", help="leave out velocity and H0 with flows as unknowns")
    parser.add_argument("--output", metavar="DIR", help="write report, table and figure to this folder")
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parser.add_argument("--version", action="version", version=f"vsh-forecast {vsh.__version__}")
    return parser


def _names(text):
    return tuple(name.strip() for name in text.split(","))


def _surveys(text):
    name, _, numbers = text.partition("=")
    try:
        n, sigma = parsing.numbers(numbers)
    except (ValueError, argparse.ArgumentTypeError):
        n, sigma = 0.5, 0.0
    if not name.strip() or n < 1 or n != int(n) or not sigma > 0:
        raise argparse.ArgumentTypeError(f"NAME=N,SIGMA is wanted, a whole number and an error in µas/yr, not {text!r}")
    return {name.strip(): (int(n), sigma)}


if __name__ == "__main__":
    sys.exit(main())
