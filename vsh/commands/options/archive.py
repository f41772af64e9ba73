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
            "vsh-archive epochs --ids quasars.fits --output epochs",
            "vsh-archive --check gaiadr4",
        ),
    )
    parser.add_argument(
        "what",
        nargs="?",
        help=(
            f"{', '.join(values.QUERIES)}, a file with a query in ADQL, a table of the archive that names sources by "
            "source_id (schema.table), or epochs: the epoch astrometry of --ids"
        ),
    )
    parser.add_argument(
        "--check",
        metavar="SCHEMA",
        help="ask for the tables and columns of a schema, gaiadr4 say, and print which queries run and what changed",
    )
    group = parser.add_argument_group("epoch astrometry (DataLink)")
    group.add_argument("--ids", metavar="FILE", help="source_id, a column of a table or one a line of a text")
    group.add_argument("--retrieval-type", metavar="NAME", help="name of the product (default: EPOCH_ASTROMETRY)")
    group.add_argument("--structure", metavar="NAME", help="how several sources come (default: COMBINED)")
    group.add_argument(
        "--batch", type=values.count(1), metavar="N", help="sources asked for at once, 5000 at most (default: 500)"
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
    if bool(options.what) == bool(options.check):
        parser.error("say what to fetch, or --check SCHEMA")
    if options.check:
        return
    given = [name for name in ("ids", "retrieval_type", "structure", "batch") if getattr(options, name) is not None]
    if (options.what == "epochs") != (options.ids is not None):
        parser.error("epochs are those of a list of sources: vsh-archive epochs --ids FILE --output FOLDER")
    if given and options.what != "epochs":
        parser.error(f"--{given[0].replace('_', '-')} is for epochs")
    if options.what == "epochs" and (options.show or not options.output):
        parser.error("epochs go into a folder: --output FOLDER")
    if not (options.output or options.show):
        parser.error("say where to: --output FILE.fits, or --show")
