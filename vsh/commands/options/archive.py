"""The options of `vsh-archive`."""

import argparse

from vsh.commands import parsing, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-archive",
        description=(
            "Fetch a catalogue from an archive (TAP), as a FITS file that vsh-fit reads. A file that is there is "
            "the answer; an interrupted call goes on where it was."
        ),
        examples=(
            "vsh-archive gaia-crf3 --output qso.fits",
            "vsh-archive gaia-crf3 --show",
            "vsh-archive query.adql --output mine.fits",
        ),
    )
    parser.add_argument(
        "what",
        help=(
            f"{', '.join(values.QUERIES)}, a file with a query in ADQL, or a table of the archive that names sources "
            "by source_id (schema.table)"
        ),
    )
    parser.add_argument(
        "--release", choices=values.RELEASES, default="DR3", help="for a table: of which release (default: DR3)"
    )
    parser.add_argument(
        "--table",
        choices=values.ASTROMETRY,
        default="gaia_source",
        help="for a table, DR4: the best model of each source (the default), or the core solution of all",
    )
    parser.add_argument("--output", metavar="FILE", help="the FITS file to be")
    parser.add_argument("--show", action="store_true", help="print the query and ask nobody")
    parser.add_argument("--url", default=values.ESA, help="of the TAP service (default: ESA's archive of Gaia)")
    parser.add_argument("--max-rows", type=values.count(1), metavar="N", help="the server's own limit unless given")
    parser.add_argument(
        "--patience",
        type=values.positive,
        default=7200.0,
        metavar="S",
        help="how long to wait for the job (default: 7200 s)",
    )
    parsing.add_overwrite(parser)
    parsing.add_common(parser, "list of what was written")
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if not (options.output or options.show):
        parser.error("say where to: --output FILE.fits, or --show")
