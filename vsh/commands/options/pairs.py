"""The options of `vsh-pairs`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-pairs",
        description=(
            "Correlate the motions of pairs of sources by the angle between them: of any number of sources, and without"
            " bias from their errors. Spin, glide and gravitational waves are fitted to the curves."
        ),
        examples=(
            "vsh-pairs catalogue.fits",
            "vsh-pairs catalogue.fits --bins 18 --powers 5 --output results",
            "vsh-pairs catalogue.fits --up-to 60 --bins 6 --html pairs.html",
        ),
    )
    parser.add_argument("catalogue", help=values.A_TABLE)
    parser.add_argument("--bins", type=values.count(1, 2000), default=14, help="of angle (default: 14)")
    parser.add_argument(
        "--up-to", type=_angle, default=180.0, metavar="DEG", help="the largest angle, degrees (default: 180)"
    )
    parser.add_argument(
        "--lmax", type=values.count(1), help="highest degree of the sums; what resolves the bins unless given"
    )
    parser.add_argument(
        "--templates",
        type=_templates,
        default=values.TEMPLATES,
        metavar="NAME,…",
        help=f"what is fitted: some of {', '.join(values.TEMPLATES)}, or none (default: all)",
    )
    parser.add_argument("--powers", type=values.count(1), metavar="L", help="powers by degree up to L from pairs, too")
    parser.add_argument(
        "--nside", type=values.nside, default=2, help="of the blocks of the sky that errors come from (default: 2)"
    )
    parsing.add_threads(parser)
    reading.add_workers(parser)
    reading.add_reading(parser)
    parsing.add_common(parser)
    return parser


def _angle(text):
    number = values.positive(text)
    if number > 180:
        raise argparse.ArgumentTypeError(f"an angle up to 180 degrees is wanted, not {text!r}")
    return number


def _templates(text):
    if text == "none":
        return ()
    templates = tuple(name.strip() for name in text.split(","))
    if not set(templates) <= set(values.TEMPLATES):
        raise argparse.ArgumentTypeError(f"none, or some of {', '.join(values.TEMPLATES)} are wanted, not {text!r}")
    return templates
