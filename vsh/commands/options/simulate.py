"""The options of `vsh-sim`."""

import argparse

from vsh.commands import parsing, values

#: Towards the Galactic centre, and towards the apex of the microwave background (Bachchan et al. 2016).
ACCELERATION = "-0.235965,-3.755779,-2.080491"
#: Lengths of mission at which errors of transits give those of a release.
YEARS = {"DR3": 2.8, "DR4": 5.0, "DR5": 10.0, "paper": 5.0}
#: What positions along scan take of the other kinds' options.
NOT_OF_EPOCHS = ("no_transits", "variability", "velocity", "redshifts", "redshift_error", "orientation")
NOT_OF_CRF3 = (
    "sky", "selection", "map_frame", "orientation", "velocity", "peculiar_dispersion", "flow", "redshifts",
    "redshift_error", "variability", "attitude", "excess_noise", "years", "dead_time", "redshift_range", "release",
    "no_transits", "wave", "columns", "units",
)  # fmt: skip
#: What radio stars take of the other kinds' options, and what is theirs alone.
NOT_OF_LINK = (*(each for each in NOT_OF_CRF3 if each != "orientation"), "tau")
OF_LINK = ("jump", "binaries", "single", "quasars")


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-sim",
        description=(
            "Simulate quasars or galaxies as Gaia sees them: every transit of a five-year mission, photocentres "
            "that vary, five-parameter solutions. The table is one that vsh-fit reads; its metadata hold the truth."
        ),
        examples=(
            "vsh-sim quasars --number 50000 --sky igql --seed 1 --output quasars.fits",
            "vsh-sim galaxies --number 10000 --velocity planck --output galaxies.fits",
            "vsh-sim epochs --number 300 --wave 2,300,0,60,-20 --output epochs.fits",
        ),
    )
    parser.add_argument(
        "kind",
        choices=["quasars", "galaxies", "vlbi", "crf3", "crf4", "epochs", "link"],
        help=(
            "vlbi: offsets from radio positions, as motions; crf3: a whole Gaia-CRF3 in the archive's columns; crf4: "
            "the same with the columns, epoch, errors and models of DR4; epochs: every transit of quasars in the "
            "columns of DR4's epoch astrometry; link: radio stars in Gaia and VLBI, for vsh-link"
        ),
    )
    parser.add_argument(
        "--number",
        type=values.count(1),
        metavar="N",
        help="how many (default: 10000; link: 40; crf3, crf4: 1215942 with five parameters, and those with six in "
        "proportion)",
    )
    parser.add_argument("--output", required=True, metavar="FILE", help="FITS, ECSV, CSV, VOTable or Parquet")
    parsing.add_overwrite(parser)
    parser.add_argument(
        "--positions",
        metavar="FILE",
        help="quasars, galaxies: positions, redshifts and magnitudes of a table of your own, in place of drawn ones "
        "(magnitudes are drawn where it has none)",
    )
    parser.add_argument(
        "--columns", type=values.columns, metavar="ROLE=NAME,…", help="names of its columns: redshift=cz"
    )
    parser.add_argument("--units", type=values.pairs, metavar="NAME=UNIT,…", help="their units: cz=km/s")
    parser.add_argument("--sky", choices=values.SKIES, help="default: uniform")
    parser.add_argument("--selection", metavar="MAP", help="a HEALPix map (FITS) of their density")
    parser.add_argument(
        "--map-frame", choices=["icrs", "galactic", "ecliptic"], help="of the map; its header's, or icrs"
    )
    parser.add_argument(
        "--spin", type=values.vector, default=(0.0, 0.0, 0.0), metavar="X,Y,Z", help="ICRS, µas/yr (default: none)"
    )
    parser.add_argument(
        "--acceleration",
        type=values.vector,
        default=values.vector(ACCELERATION),
        metavar="X,Y,Z",
        help="ICRS, µas/yr (default: 4.3 towards the Galactic centre)",
    )
    parser.add_argument(
        "--orientation", type=values.vector, default=(0.0, 0.0, 0.0), metavar="X,Y,Z", help="vlbi, link: ICRS, µas"
    )
    parser.add_argument(
        "--jump",
        type=values.vector,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="link: what the spin of those fainter than G = 13 is more, µas/yr",
    )
    parser.add_argument("--binaries", type=values.fraction, default=0.1, help="link: their share (default: 0.1)")
    parser.add_argument(
        "--single", type=values.fraction, default=0.0, metavar="SHARE", help="link: seen at single epochs (default: 0)"
    )
    parser.add_argument("--quasars", type=values.count(0), default=0, metavar="N", help="link: beside the stars")
    parser.add_argument(
        "--velocity",
        type=values.velocity,
        metavar="planck|SPEED,L,B",
        help="galaxies: ours, km/s toward Galactic degrees",
    )
    parser.add_argument("--h0", type=values.positive, default=67.3, help="km/s/Mpc (default: 67.3)")
    parser.add_argument(
        "--peculiar-dispersion",
        type=values.not_negative,
        default=0.0,
        metavar="SIGMA",
        help="galaxies: dispersion, km/s",
    )
    parser.add_argument("--flow", choices=["linear"], help="galaxies: add the flow of linear theory, which they share")
    parser.add_argument(
        "--redshifts",
        choices=["true", "heliocentric", "cmb"],
        default="true",
        help="of the expansion alone, or as they are seen, with velocities in them (default: true)",
    )
    parser.add_argument(
        "--redshift-error", type=_redshift_error, default=0.0, metavar="SIGMA", help="or spectroscopic, photometric"
    )
    parser.add_argument(
        "--variability", type=values.not_negative, default=0.0, metavar="SIGMA", help="of photocentres, µas"
    )
    parser.add_argument("--tau", type=values.positive, default=2.0, help="its correlation time, yr (default: 2)")
    parser.add_argument(
        "--attitude",
        type=_attitude,
        default=10.0,
        metavar="SIGMA|solved",
        help="noise, µas (default: 10); or solved together with the sources, see vsh-agis",
    )
    parser.add_argument(
        "--excess-noise", type=values.not_negative, default=0.0, metavar="SIGMA", help="added to every transit, µas"
    )
    parser.add_argument(
        "--years",
        type=values.positive,
        help=(
            "length of the mission (default: that of the release, "
            f"{', '.join(f'{name} {years:g}' for name, years in YEARS.items())})"
        ),
    )
    parser.add_argument("--redshift-range", type=_range, metavar="LOW,HIGH", help="of galaxies (default: 0.001,0.03)")
    parser.add_argument("--dead-time", type=values.not_negative, default=0.06, metavar="FRACTION", help="default: 0.06")
    parser.add_argument("--release", choices=["DR3", "DR4", "DR5", "paper"], default="DR4", help="whose errors")
    parser.add_argument(
        "--table",
        choices=values.ASTROMETRY,
        default="gaia_source",
        help="crf4: which table of DR4: the best model of each source, or the core solution of all",
    )
    parser.add_argument(
        "--traps",
        action="store_true",
        help="crf3, crf4: with errors that sources share, stars among the quasars, and faint errors that are too small",
    )
    parser.add_argument(
        "--wave",
        type=values.numbers,
        metavar="F,PLUS,CROSS,L,B",
        help="epochs: a gravitational wave of F a year, strains in µas, that travels to ICRS degrees L, B",
    )
    parser.add_argument("--no-transits", action="store_true", help="errors by place and magnitude, without transits")
    parser.add_argument("--seed", type=int, default=1, help="the same seed, the same table (default: 1)")
    parsing.add_threads(parser)
    parsing.add_common(parser, "list of what was written")
    return parser


def _range(text):
    low, *high = values.numbers(text)
    if len(high) != 1 or not 0 < low < high[0]:
        raise argparse.ArgumentTypeError(f"two rising redshifts above zero are wanted, not {text!r}")
    return low, high[0]


def _attitude(text):
    return text if text == "solved" else values.not_negative(text)


def _redshift_error(text):
    return text if text in values.REDSHIFT_ERRORS else values.not_negative(text)


def _foreign(parser, options, names):
    """Options among `names` that were given, as they are typed."""
    given = [name for name in names if getattr(options, name) != parser.get_default(name)]
    return [f"--{name.replace('_', '-')}" for name in given]


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself; a number that nobody gave is set."""
    if options.selection and options.sky:
        parser.error("--sky and --selection exclude each other")
    if options.positions:
        drawn = [f"--{name}" for name in ("number", "sky", "selection") if getattr(options, name) is not None]
        if drawn or options.redshift_range:
            parser.error(
                f"--positions takes the sources of a table: {', '.join(drawn) or '--redshift-range'} draws others"
            )
        if options.kind not in ("quasars", "galaxies"):
            parser.error("--positions is for quasars and galaxies")
    elif options.columns or options.units:
        parser.error("--columns and --units are of the table of --positions")
    if options.velocity is not None and options.kind != "galaxies":
        parser.error("--velocity is for galaxies: quasars are too far to show it")
    if options.flow and options.kind != "galaxies":
        parser.error("--flow is for galaxies: quasars are too far to show it")
    if options.wave is not None and (options.kind != "epochs" or len(options.wave) != 5 or options.wave[0] <= 0):
        parser.error("--wave is for epochs: a frequency above zero, plus, cross, and a direction, as 2,100,0,30,-20")
    if options.kind == "epochs":
        foreign = _foreign(parser, options, NOT_OF_EPOCHS)
        if foreign:
            parser.error(f"epochs are positions of quasars along scan: {', '.join(foreign)} cannot be chosen")
        options.years = 5.5 if options.years is None else options.years
        options.number = 500 if options.number is None else options.number
    if options.table != "gaia_source" and options.kind != "crf4":
        parser.error("--table is for crf4")
    if options.traps and options.kind not in ("crf3", "crf4"):
        parser.error("--traps is for crf3 and crf4")
    foreign = _foreign(parser, options, OF_LINK) if options.kind != "link" else []
    if foreign:
        parser.error(f"{foreign[0]} is for link")
    if options.kind == "link":
        foreign = _foreign(parser, options, NOT_OF_LINK)
        if foreign:
            parser.error(f"radio stars are seen by Gaia and VLBI as they are: {', '.join(foreign)} cannot be chosen")
        options.number = 40 if options.number is None else options.number
    if options.kind in ("crf3", "crf4"):
        foreign = _foreign(parser, options, NOT_OF_CRF3)
        if foreign:
            parser.error(f"{options.kind} is as it is: {', '.join(foreign)} cannot be chosen")
    elif options.number is None:
        options.number = 10_000
    if options.redshift_range and options.kind != "galaxies":
        parser.error("--redshift-range is for galaxies")
    if options.years is None and options.kind not in ("crf3", "crf4"):
        options.years = YEARS[options.release]
    if options.attitude == "solved" and options.no_transits:
        parser.error("--attitude solved needs transits, which --no-transits leaves out")
    if options.variability and options.no_transits:
        parser.error("--variability needs transits, which --no-transits leaves out")
