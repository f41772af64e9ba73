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
            "vsh-fit catalogue.fits --recommended --html page.html",
            "vsh-fit catalogue.fits --lmax 5 --floor --classes magnitude:18,19",
        ),
    )
    parser.add_argument("catalogue", nargs="?", help=values.A_TABLE)
    parser.add_argument("--demo", action="store_true", help="run on a simulated catalogue that comes with the package")
    parser.add_argument("--lmax", type=values.count(1), help="highest degree (default: 3, with --recommended 5)")
    clips = parser.add_mutually_exclusive_group()
    clips.add_argument(
        "--clip",
        type=values.positive,
        metavar="KAPPA",
        help="leave out sources with residuals larger than KAPPA times the median",
    )
    clips.add_argument(
        "--clip-threshold",
        type=values.positive,
        metavar="X",
        help="leave out sources with residuals larger than X errors",
    )
    errors = parser.add_mutually_exclusive_group()
    errors.add_argument(
        "--robust", choices=["student", "permissive"], help="robust likelihood, for catalogues with some wrong errors"
    )
    errors.add_argument(
        "--excess-noise",
        nargs="?",
        const="add",
        choices=["add", "scale"],
        help="add a variance to every source, by maximum likelihood; with 'scale', a factor on its errors too",
    )
    errors.add_argument("--bootstrap", type=values.count(2), metavar="N", help="errors from N draws of the sources")
    errors.add_argument(
        "--jackknife",
        type=values.nside,
        nargs="?",
        const=0,
        metavar="NSIDE",
        help=(
            "errors from leaving out HEALPix blocks; without NSIDE several sizes are compared and the report says which"
            " is long enough"
        ),
    )
    parser.add_argument(
        "--recommended",
        action="store_true",
        help=(
            "Student's t with the systematic floor in the errors, to degree 5 (or --lmax), lowered where the sources "
            "are too few for it"
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
    if options.recommended:
        given = ("robust", "excess_noise", "bootstrap", "jackknife", "clip", "clip_threshold")
        named = [f"--{name.replace('_', '-')}" for name in given if getattr(options, name) is not None]
        if named:
            parser.error(f"--recommended chooses the errors itself: leave out {', '.join(named)}")
    if options.lmax is None:
        options.lmax = 5 if options.recommended else 3
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
            "put errors that sources share into the errors of spin and acceleration, estimated from degrees 2 to --lmax"
            " (3 at least), and a prior of that power on those degrees"
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
