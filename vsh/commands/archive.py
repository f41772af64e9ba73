"""`vsh-archive`: catalogues from an archive, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import vsh
from vsh.archive import ESA, QUERIES, query
from vsh.commands import parsing, running
from vsh.errors import ArchiveError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-archive`; returns the exit status: 0, 1 (the archive did not answer) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if not (options.output or options.show):
        parser.error("say where to: --output FILE.fits, or --show")
    return running.guarded("vsh-archive", lambda: _run(options))


def _run(options):
    adql = QUERIES[options.what] if options.what in QUERIES else _text(options.what)
    if options.show:
        running.say(adql)
        return
    there = Path(options.output).exists() and not options.overwrite
    path = query(
        adql,
        options.output,
        options.url,
        patience=options.patience,
        max_rows=options.max_rows,
        overwrite=options.overwrite,
    )
    known = Path(f"{path}.json").exists()
    was = f"{path} was there already: nothing was asked" + (
        "" if known else "; whether it answers this query is not known"
    )
    running.say(was if there else f"written to {path}")


def _text(path):
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ArchiveError(
            f"{path} is neither a query of ours ({', '.join(QUERIES)}) nor a file with one: "
            f"{getattr(error, 'strerror', None) or error}"
        ) from None


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-archive",
        description="Fetch a catalogue from an archive (TAP), as a FITS file that vsh-fit reads. A file that is there is "
        "the answer; an interrupted call goes on where it was.",
        epilog="Example: vsh-archive gaia-crf3 --output qso.fits, then vsh-fit qso.fits --clip 3",
    )
    parser.add_argument("what", help=f"{', '.join(QUERIES)}, or a file with a query in ADQL")
    parser.add_argument("--output", metavar="FILE", help="the FITS file to be")
    parser.add_argument("--show", action="store_true", help="print the query and ask nobody")
    parser.add_argument("--url", default=ESA, help="of the TAP service (default: ESA's archive of Gaia)")
    parser.add_argument("--max-rows", type=parsing.count(1), metavar="N", help="the server's own limit unless given")
    parser.add_argument(
        "--patience",
        type=parsing.positive,
        default=7200.0,
        metavar="S",
        help="how long to wait for the job (default: 7200 s)",
    )
    parsing.add_overwrite(parser)
    parser.add_argument("--version", action="version", version=f"vsh-archive {vsh.__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
