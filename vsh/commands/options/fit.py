"""The options of `vsh-fit`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-fit",
        description=(
            "Fit vector spherical harmonics to a catalogue of proper motions: the spin of its frame, the "
            "acceleration of the Solar System, and the power of every degree."
        ),
        examples=(
            "vsh-fit catalogue.fits --lmax 3 --frame galactic --output results",
            "vsh-fit catalogue.fits --method clip=3 --html page.html",
            "vsh-fit catalogue.fits --classes magnitude:18,19",
        ),
    )
    parser.add_argument("catalogue", nargs="?", help=values.A_TABLE)
    parser.add_argument("--demo", action="store_true", help="run on a simulated catalogue that comes with the package")
    parser.add_argument("--lmax", type=values.count(1), help="highest degree (default: 5; with --method 3)")
    parser.add_argument(
        "--method",
        type=values.method,
        default="recommended",
        metavar="NAME[=VALUE]",
        help=(
            "estimator (default: recommended, which is Student's t with the systematic floor in the errors, to a "
            "degree that the sources bear): least-squares, clip=KAPPA, student, permissive, excess-noise[=scale], "
            "bootstrap=N or jackknife[=NSIDE]"
        ),
    )
    _add_backgrounds(parser)
    parser.add_argument(
        "--classes",
        metavar="COLUMN:EDGE,…",
        help=(
            "compare classes of sources, with errors that they share (--lmax 5 is best): by a column, magnitude:18,20, "
            "by conditions between semicolons, or halves:galactic"
        ),
    )
    parser.add_argument(
        "--templates",
        type=values.names,
        metavar="MAP,…",
        help=(
            "how far motions follow maps, cut to --lmax: HEALPix maps (FITS), solutions (ECSV), columns of the "
            "catalogue, or density, that of the sources"
        ),
    )
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap and of the classes (default: 1)")
    parsing.add_threads(parser)
    reading.add_workers(parser)
    reading.add_reading(parser)
    parser.add_argument(
        "--beside", action="store_true", help="in the page of --html, also show plain least squares of all sources"
    )
    parsing.add_common(parser)
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.catalogue) == options.demo:
        parser.error("name one catalogue, or --demo")
    if options.lmax is None:
        options.lmax = 5 if options.method == "recommended" else 3
    if options.classes and options.lmax < 3:
        parser.error("--classes needs --lmax 3 or more: degrees 1 and 2 say nothing of what classes share")
    if options.templates and options.lmax < 3:
        parser.error("--templates needs --lmax 3 or more, 5 is best: degrees 1 and 2 alone tell them from nothing")
    if options.years and not options.waves:
        parser.error("--years is for --waves")
    if options.beside and not options.html:
        parser.error("--beside is for the page: name it, --html FILE")


def _add_backgrounds(parser):
    group = parser.add_argument_group("what sources share")
    group.add_argument(
        "--floor",
        action="store_true",
        help=(
            "put the systematic floor into the errors of another --method than the recommended one, estimated from "
            "degrees 2 to --lmax (3 at least), with a prior of that power on those degrees"
        ),
    )
    group.add_argument(
        "--waves", action="store_true", help="limit the energy in gravitational waves by degree 2, of three kinds"
    )
    group.add_argument(
        "--years",
        type=values.positive,
        metavar="T",
        help="with --waves: how long the motions were measured, for the band of frequency and the strain",
    )
