"""The options of `vsh-referee`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-referee",
        description=(
            "Repeat every published analysis of the motions of quasars on one catalogue, with the errors that sources "
            "share, and ask what a referee would: is it the sky, or the instrument?"
        ),
        examples=(
            "vsh-referee crf3.fits --on-bad drop --output referee --html referee.html",
            "vsh-referee crf4.fits --on-bad drop --earlier crf3.fits",
            'vsh-referee crf3.fits --on-bad drop --where "phot_g_mean_mag < 19"',
        ),
    )
    parser.add_argument("catalogue", help=values.A_TABLE)
    parser.add_argument(
        "--earlier",
        metavar="FILE",
        help="motions of the same sources in an earlier release, by source_id: is the acceleration the same there?",
    )
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn (default: 1)")
    parsing.add_threads(parser)
    reading.add_reading(parser)
    parsing.add_common(parser)
    return parser
