"""The options of `vsh-waves`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-waves",
        description=(
            "Look for gravitational waves within the mission in epoch astrometry: limits by frequency, backgrounds, and"
            " fields that change with time, with what an attitude solved from the same sky took of them."
        ),
        examples=(
            "vsh-waves epochs.fits --frequencies 0.25:4:16 --output waves",
            "vsh-waves epochs.fits --frequencies 2 --background --in-time 4",
            "vsh-waves epochs.fits --frequencies 2 --attitude known",
        ),
    )
    add = parser.add_argument
    add("epochs", help="a file of epoch astrometry in DR4's columns, or a folder of them")
    add(
        "--frequencies",
        type=_frequencies,
        default=_frequencies("0.25:4:16"),
        metavar="LOW:HIGH:N",
        help="of single waves, a year; or some of them, as 0.5,1,2 (default: 0.25:4:16)",
    )
    add(
        "--attitude",
        choices=["solved", "known"],
        default="solved",
        help="solved from the same sky, as Gaia's is, or known from elsewhere (default: solved)",
    )
    add("--law", metavar="FILE", help="the scanning law, Gaia's commanded_scan_law; a nominal one unless given")
    add("--law-nside", type=values.nside, default=8, metavar="NSIDE", help="of what stars take up of it (default: 8)")
    add("--positions", metavar="FILE", help="source_id, ra and dec, for epochs without ra0 and dec0")
    add("--lmax", type=values.count(2, 20), default=5, help="highest degree (default: 5)")
    add("--nside", type=values.nside, default=8, help="of the map of directions (default: 8)")
    add("--skies", type=values.count(1), default=1000, metavar="N", help="of noise, for p-values (default: 1000)")
    add("--background", action="store_true", help="powers of a background in bands of .5, 1, 2 and 4 a year")
    add("--in-time", type=values.count(2, 60), metavar="K", help="fields by Legendre polynomials of time to K")
    add("--seed", type=int, default=1, help="the same seed, the same p-values (default: 1)")
    parsing.add_threads(parser)
    add("--output", metavar="DIR", help="write report, tables and figures to this folder")
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


def _frequencies(text):
    if ":" not in text:
        each = values.numbers(text)
        if not all(f > 0 for f in each):
            raise argparse.ArgumentTypeError(f"frequencies above zero are wanted, not {text!r}")
        return each
    try:
        low, high, count = text.split(":")
        limits = float(low), float(high), int(count)
    except ValueError:
        limits = (0.0, 0.0, 0)
    if not (0 < limits[0] < limits[1] and 1 < limits[2] <= 10_000):
        raise argparse.ArgumentTypeError(f"LOW:HIGH:N with 0 < LOW < HIGH is wanted, as 0.25:4:16, not {text!r}")
    low_f, high_f, n = limits
    return tuple(low_f + (high_f - low_f) * i / (n - 1) for i in range(n))
