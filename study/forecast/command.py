"""`vsh-forecast`: what catalogues to come will tell, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from vsh.commands import finishing, outputs, parsing, running
from vsh.commands.options import forecast as words
from vsh.errors import VshError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-forecast`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    return run(parsing.parse(words, arguments))


def run(options: argparse.Namespace) -> int:
    """What the command does, with its options parsed; returns the exit status.

    Parameters
    ----------
    options : argparse.Namespace
        Of `vsh.commands.parsing.parse`.
    """
    return running.guarded(options, lambda: _run(options))


def _run(options):
    outputs.check(options)
    from study.forecast import SURVEYS, Survey, forecast

    surveys = dict(SURVEYS)
    for name in options.only or ():
        if name not in surveys:
            raise VshError(f"no survey is called {name!r}: {', '.join(surveys)} are")
    surveys = {name: surveys[name] for name in options.only or surveys}
    for name, (n, sigma) in (options.survey or {}).items():
        surveys[name] = Survey(n, sigma=sigma, says="as given")
    found = forecast(surveys, sky=options.sky, flows=not options.no_flows)
    finishing.finish(
        options, finishing.Found(found.report(), {"Errors to come": found.to_table()}), provenance=lambda: running.provenance([], options),
        draw=lambda: {"forecast": found.plot()}, write=lambda folder, meta: _write(folder, found, meta), title="What catalogues to come will tell",
    )  # fmt: skip


def _write(folder, found, meta):
    from vsh import tables

    tables.write_table(found.to_table(), folder / "forecast.ecsv", meta)


if __name__ == "__main__":
    sys.exit(main())
