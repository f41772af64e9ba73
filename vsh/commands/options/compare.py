"""The options of `vsh-compare`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-compare",
        description=(
            "Match two catalogues of one sky and fit their differences, with both covariances: how one frame is turned "
            "against the other, drifts and is deformed, and which sources do not fit."
        ),
        examples=(
            "vsh-compare icrf3sx.txt icrf2-all.txt --output comparison --html comparison.html",
            "vsh-compare one.fits two.fits three.fits",
            "vsh-compare one.fits two.fits --lmax 1 --parameters spin --method student",
        ),
    )
    parser.add_argument("catalogue", help=f"ICRF2 or ICRF3 as the IERS distributes them, or {values.A_TABLE}")
    parser.add_argument("catalogue2", help="the one that is subtracted")
    parser.add_argument(
        "others",
        nargs="*",
        default=[],
        metavar="catalogue3",
        help="more that are subtracted from the first, each by itself",
    )
    parser.add_argument("--lmax", type=values.count(1), default=2, help="highest degree of the fit (default: 2)")
    parser.add_argument(
        "--what",
        choices=["positions", "motions"],
        help="what is compared (default: motions where both have some, positions otherwise)",
    )
    parser.add_argument(
        "--by", choices=["name", "position"], default="name", help="how sources are matched (default: name)"
    )
    parser.add_argument(
        "--radius", type=values.positive, metavar="ARCSEC", help="of a match by position, arcsec (default: 1)"
    )
    parser.add_argument(
        "--threshold",
        type=values.positive,
        default=5.0,
        metavar="X",
        help="differences beyond so many errors are left out and listed (default: 5)",
    )
    parser.add_argument(
        "--position-error", type=values.positive, metavar="UAS", help="one error for all positions, µas"
    )
    parser.add_argument(
        "--parameters",
        choices=["degree", "orientation", "spin", "glide"],
        default="degree",
        help="also fit the rotation (orientation of positions, spin of motions) or the glide alone (default: degree)",
    )
    parser.add_argument(
        "--method",
        type=values.method,
        default="least-squares",
        metavar="NAME[=VALUE]",
        help=(
            "estimator: least-squares (default; errors scaled in classes of their size), student, excess-noise, "
            "bootstrap=N or jackknife"
        ),
    )
    floors = parser.add_mutually_exclusive_group()
    floors.add_argument(
        "--floor",
        action="store_true",
        help=(
            "rotation and glide with the errors that sources share over the sky as well, from degrees 2 to 5 of the "
            "differences; from 100000 sources on that is done unasked"
        ),
    )
    floors.add_argument("--no-floor", action="store_true", help="leave them out: the report has their size")
    parser.add_argument("--seed", type=int, default=1, help="of the draws of what sources share (default: 1)")
    parser.add_argument(
        "--where2",
        metavar="CONDITION",
        help="rows of the second catalogue, and those behind it, to use (default: as --where)",
    )
    parsing.add_threads(parser)
    reading.add_reading(parser)
    parsing.add_common(parser)
    return parser


#: Estimators of the differences, and the fewest replicates.
_METHODS, _LEAST = ("least-squares", "student", "excess-noise", "bootstrap", "jackknife"), 10


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with an estimator or a value that a comparison does not know."""
    method, value = values.method_and_value(options.method)
    if method not in _METHODS:
        parser.error(f"--method of a comparison is {', '.join(_METHODS)}, not {method}")
    if value is not None and method != "bootstrap":
        parser.error(f"--method {method} of a comparison takes no value")
    if value is not None and int(value) < _LEAST:
        parser.error(f"--method bootstrap takes {_LEAST} replicates at least, not {value}")
