"""The options of `vsh-agis`."""

import argparse

from vsh.commands import parsing, reading, values

#: Sources that a solution has unless told.
_QUASARS = 5000


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-agis",
        description=(
            "Solve quasars, galaxies and stars together with the attitude of the satellite that sees them, by conjugate"
            " gradients. A run that is killed goes on where it was when it is started again."
        ),
        examples=(
            "vsh-agis --quasars 20000 --sky igql --exact --output igql",
            "vsh-agis --quasars 2000 --stars 2000 --attitude 10 --output known",
            "vsh-agis --quasars 500000 --plan",
        ),
    )
    add = parser.add_argument
    add("--quasars", type=values.count(1), default=_QUASARS, metavar="N", help=f"how many (default: {_QUASARS})")
    add(
        "--stars",
        type=values.count(0),
        default=0,
        metavar="N",
        help="of the background, by counts of magnitude (default: none)",
    )
    add(
        "--star-error",
        type=values.positive,
        metavar="SIGMA",
        help="of a star's transit, µas; by magnitude unless given",
    )
    add("--galaxies", type=values.count(0), default=0, metavar="N", help="how many (default: none)")
    add(
        "--vlbi",
        type=values.count(0),
        default=0,
        metavar="N",
        help="quasars with radio positions, which end it with a frame rotator",
    )
    add("--sky", choices=values.SKIES, default="uniform", help="of the quasars (default: uniform)")
    add(
        "--knots",
        type=values.positive,
        default=30.0,
        metavar="SECONDS",
        help="of the whole mission's attitude (default: 30)",
    )
    add(
        "--no-scaling",
        dest="scale",
        action="store_false",
        help="of the mission to the number of sources; half a million are the whole",
    )
    add(
        "--start",
        type=_two,
        default=(1e5, 1e4),
        metavar="RANDOM,SYSTEMATIC",
        help="errors to begin with, µas (default: 100000,10000)",
    )
    add(
        "--start-attitude",
        type=values.not_negative,
        default=10.0,
        metavar="SIGMA",
        help="the attitude's, µas (default: 10)",
    )
    add(
        "--attitude",
        type=_attitude,
        default="solved",
        metavar="solved|SIGMA",
        help="solved, or known from elsewhere to so many µas",
    )
    add(
        "--smoothing",
        type=values.positive,
        default=1e6,
        metavar="SIGMA",
        help="of second differences, µas: bridges gaps (default: 1e6)",
    )
    add(
        "--global",
        dest="motions",
        type=_motions,
        metavar="acceleration|DEGREE|velocity",
        help="parameters inside the solution that motions follow",
    )
    add(
        "--scatter",
        type=values.positive,
        default=10.0,
        metavar="SIGMA",
        help="of motions about --global, µas/yr (default: 10)",
    )
    add("--first", choices=["sources", "attitude"], default="sources", help="what is updated first (default: sources)")
    add(
        "--method",
        choices=["conjugate", "simple"],
        default="conjugate",
        help="gradients, or the simple iteration, which creeps",
    )
    add("--iterations", type=values.count(1), default=500, metavar="N", help="at most (default: 500)")
    add(
        "--stop",
        type=values.positive,
        default=0.05,
        metavar="ERRORS",
        help="by which degrees 1 to 3 may move in ten iterations (default: 0.05)",
    )
    add("--exact", action="store_true", help="exact errors of spin and acceleration besides, by six more solutions")
    add(
        "--across",
        type=values.positive,
        default=5.0,
        metavar="FACTOR",
        help="errors across the scan in those along (default: 5)",
    )
    add("--ccds", type=int, choices=[1, 9], default=1, help="observations in a transit (default: 1)")
    add(
        "--variability",
        type=values.not_negative,
        default=0.0,
        metavar="SIGMA",
        help="of the quasars' photocentres, µas",
    )
    add("--tau", type=values.positive, default=2.0, help="its correlation time, yr (default: 2)")
    add("--years", type=values.positive, default=5.0, help="length of the mission (default: 5)")
    add("--dead-time", type=values.not_negative, default=0.06, metavar="FRACTION", help="default: 0.06")
    add("--release", choices=["DR3", "DR4", "DR5", "paper"], default="DR4", help="whose errors")
    add(
        "--spin",
        type=values.vector,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="true, of motions.fits, ICRS, µas/yr",
    )
    add(
        "--acceleration",
        type=values.vector,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="true, of motions.fits, ICRS, µas/yr",
    )
    add(
        "--map",
        action="store_true",
        help="keep transits, observations and the attitude's factor on disk while it runs, beside DIR: memory is then"
        " 1.1 kB a source",
    )
    add("--plan", action="store_true", help="only say what memory and time it would take")
    add("--seed", type=int, default=1, help="the same seed, the same results (default: 1)")
    add(
        "--workers",
        "--threads",
        dest="threads",
        type=values.count(1),
        metavar="N",
        help="one a core unless given; changes no digit of the results",
    )
    add("--output", metavar="DIR", help="a new folder for report, motions, sources and figures")
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


def _two(text):
    days = values.numbers(text)
    if len(days) != 2 or min(days) < 0:
        raise argparse.ArgumentTypeError(f"two numbers that are not negative are wanted, not {text!r}")
    return days


def _attitude(text):
    return text if text == "solved" else values.positive(text)


def _motions(text):
    if text.isdecimal() and int(text) > 0:
        return int(text)
    if text not in ("acceleration", "velocity"):
        raise argparse.ArgumentTypeError(f"acceleration, velocity or a degree is wanted, not {text!r}")
    return text


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if not options.plan and not options.output:
        parser.error("say where results go, --output DIR, or --plan, which only tells what they would take")
    if options.vlbi > options.quasars:
        parser.error(f"--vlbi: {options.vlbi} of {options.quasars} quasars cannot be chosen")
    if options.motions == "velocity" and not options.galaxies:
        parser.error("--global velocity is told by galaxies: say --galaxies N")
