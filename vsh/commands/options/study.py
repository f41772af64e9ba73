"""The options of `vsh-study`."""

import argparse

from vsh.commands import parsing, reading, values


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
    parser.add_argument("configuration", nargs="?", help="a TOML file (docs/study.md)")
    parser.add_argument(
        "--gaia",
        metavar="FILE",
        help=(
            "the acceleration paper of Gaia Collaboration, Klioner et al. (2021), from a file of "
            "vsh-archive gaia-crf3 or vsh-sim crf3"
        ),
    )
    parser.add_argument("--output", required=True, metavar="DIR", help="a new folder, or that of the same study")
    parser.add_argument("--n-realisations", type=values.count(1), metavar="N", help="in place of the configuration's")
    parser.add_argument("--workers", type=values.count(1), metavar="N", help="processes; one a core unless given")
    parser.add_argument("--lmax", type=values.count(3), default=10, help="--gaia: the highest degree (default: 10)")
    parser.add_argument(
        "--n-bootstrap",
        type=values.count(10),
        default=500,
        metavar="N",
        help="--gaia: draws of each fit (default: 500)",
    )
    parser.add_argument("--seed", type=int, default=1, help="--gaia: of the bootstrap (default: 1)")
    parsing.add_threads(parser)
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.configuration) + bool(options.gaia) != 1:
        parser.error("name a configuration, or --gaia FILE")
