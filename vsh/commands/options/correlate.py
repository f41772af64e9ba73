"""The options of `vsh-correlate`."""

import argparse
import re

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-correlate",
        description=(
            "Show which parameters are correlated on a catalogue's sky: which part of the sky causes it, and what leaks"
            " into a fit from degrees that were left out. Positions and errors are enough; no motions are needed."
        ),
        examples=(
            "vsh-correlate catalogue.fits --lmax 2",
            "vsh-correlate catalogue.fits catalogue2.fits --frame galactic --output results",
            "vsh-correlate catalogue.fits --influence omega_y,a_x --leakage 6 --output influence",
        ),
    )
    parser.add_argument("catalogue", help=values.A_TABLE)
    parser.add_argument("catalogue2", nargs="?", help="a second one, for the other triangle of the matrix")
    parser.add_argument("--lmax", type=values.count(1), default=1, help="highest degree of the fit (default: 1)")
    parser.add_argument(
        "--parameters",
        choices=[values.FRAME, "modes"],
        default=values.FRAME,
        help="spin and acceleration (with --lmax 1), or all coefficients",
    )
    parser.add_argument(
        "--influence",
        type=_pair,
        action="append",
        metavar="NAME,NAME",
        help="map what drives the correlation of two parameters, or the variance of one: omega_y,a_x; may be repeated",
    )
    parser.add_argument("--nside", type=values.nside, default=16, help="of these maps (default: 16)")
    parser.add_argument(
        "--add-sources", type=values.count(1), default=1000, metavar="N", help="sources to add (default: 1000)"
    )
    parser.add_argument(
        "--leakage", type=values.count(2), metavar="L", help="bias of the fit by degrees up to L that are not fitted"
    )
    parser.add_argument(
        "--power-per-degree",
        type=values.not_negative,
        default=1.0,
        metavar="P",
        help="their power a degree and kind, (µas/yr)² (default: 1)",
    )
    parser.add_argument("--sigma", type=values.positive, help="one error for all sources, µas/yr")
    parsing.add_threads(parser)
    reading.add_workers(parser)
    reading.add_reading(parser)
    parsing.add_common(parser)
    return parser


def _pair(text):
    parameters = tuple(name.strip() for name in re.findall(r"[^,()]+(?:\([^)]*\))?", text))
    if len(parameters) not in (1, 2) or not all(parameters) or len(set(parameters)) != len(parameters):
        raise argparse.ArgumentTypeError(f"one or two different names are wanted, not {text!r}")
    return parameters


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself; several degrees mean all coefficients."""
    if options.leakage is not None and options.leakage <= options.lmax:
        parser.error(f"--leakage is the highest degree that is not fitted: more than --lmax {options.lmax}")
    if options.parameters == values.FRAME and options.lmax > 1:
        options.parameters = "modes"
