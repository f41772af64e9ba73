"""The options of `vsh-link`."""

import argparse

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-link",
        description=(
            "Link frames over all magnitudes: orientation and spin of Gaia against VLBI (or any catalogues) from radio "
            "stars with parallaxes, single epochs, and quasars; outliers by the likelihood, none by hand."
        ),
        examples=(
            "vsh-link gaia.csv vlbi.csv --steps 13 --output link",
            "vsh-link gaia.csv vlbi.csv --order 1",
            "vsh-link gaia.csv vlbi.csv --no-offset --html link.html",
        ),
    )
    add = parser.add_argument
    add(
        "catalogues",
        nargs="+",
        metavar="TABLE",
        help="names, epochs, and what was measured of ra, dec, parallax, pmra, pmdec with their errors; a catalogue "
        "each, or all in one (a column catalogue, or columns with a suffix such as _VLBI)",
    )
    add("--reference", metavar="NAME", help="the catalogue that is not turned (default: vlbi… or icrf…)")
    add(
        "--unknowns",
        type=values.names,
        default=["orientation", "spin"],
        metavar="NAMES",
        help="of orientation, spin, acceleration (default: orientation,spin)",
    )
    add("--steps", type=values.numbers, default=(), metavar="G,…", help="magnitudes at which the frame jumps")
    add(
        "--seek-step",
        type=values.numbers,
        nargs="?",
        const=(),
        metavar="G,…",
        help="find the magnitude at which the frame jumps, among these (default: 12 between those of the sources)",
    )
    add("--order", type=values.count(0, 6), default=0, help="powers of (G − 13) that it has (default: 0)")
    add("--colour-order", type=values.count(0, 6), default=0, help="powers of (colour − 1) that it has (default: 0)")
    add("--epoch", type=float, default=2016.0, help="of the orientation (default: 2016)")
    add("--priors", metavar="FILE", help="spins or orientations from elsewhere: x, y, z, x_error …, magnitude")
    add("--no-robust", action="store_true", help="normal errors in place of tails found from the data")
    add("--scale", type=values.positive, metavar="X", help="by which all errors are multiplied, in place of finding it")
    add("--epochs", type=values.pairs, metavar="NAME=EPOCH", help="of tables without such a column (icrf3sx=2015)")
    add("--quasars", type=values.names, default=(), metavar="NAME,…", help="tables of quasars alone, where none says")
    add("--fixed", type=values.pairs, metavar="NAME=EPOCH", help="catalogues tied to calibrators with fixed places")
    add("--no-aberration", action="store_true", help="leave out what the Solar System's acceleration does")
    add("--no-parallax", action="store_true", help="positions of single epochs are free of parallax")
    add("--no-light-time", action="store_true", help="stars move as if light needed no time")
    add("--no-offset", action="store_true", help="no offset between the reference's positions and the others is sought")
    add("--candidates", metavar="FILE", help="planned astrometry: which of its sources would tell most")
    parsing.add_threads(parser)
    add("--output", metavar="DIR", help="write report, tables and figures to this folder")
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser
