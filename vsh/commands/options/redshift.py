"""The options of `vsh-redshift`."""

import argparse
from itertools import pairwise
from pathlib import Path

from vsh.commands import parsing, reading, values


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-redshift",
        description=(
            "Fit our velocity or the Hubble constant to proper motions and redshifts: our velocity for a known Hubble "
            "constant, the Hubble constant for a known velocity, the posterior of both, and spin and acceleration in "
            "bins of redshift."
        ),
        examples=(
            "vsh-redshift galaxies.fits --h0 67.4",
            "vsh-redshift galaxies.fits --bins 3 --lmax 5 --floor --output results",
            "vsh-redshift galaxies.fits --posterior --velocity planck --n-samples 20000",
        ),
    )
    parser.add_argument("catalogue", help=values.A_TABLE)
    parser.add_argument(
        "--h0", type=values.positive, metavar="H0", help="fit our velocity for this Hubble constant, km/s/Mpc"
    )
    parser.add_argument(
        "--velocity",
        type=values.velocity,
        metavar="planck|SPEED,L,B",
        help="fit H0 for this velocity: planck, or its speed in km/s and Galactic apex in degrees",
    )
    parser.add_argument(
        "--bins", type=_edges, metavar="N|Z,Z,…", help="spin and acceleration in bins of redshift: edges, or how many"
    )
    parser.add_argument("--lmax", type=values.count(1), default=1, help="highest degree in the bins (default: 1)")
    floors = parser.add_mutually_exclusive_group()
    floors.add_argument(
        "--floor",
        action="store_true",
        help=(
            "with --bins: errors that sources share, from the power of degrees 2 to --lmax (to 5 where that is 1), and "
            "whether the dipole changes with redshift; from 100000 sources on that is done unasked"
        ),
    )
    floors.add_argument("--no-floor", action="store_true", help="leave them out: the report has their size")
    parser.add_argument("--shared-higher-degrees", action="store_true", help="degrees above 1 the same in all bins")
    parser.add_argument(
        "--peculiar-dispersion",
        type=_dispersion,
        metavar="SIGMA|free",
        help=(
            "dispersion of peculiar velocities in each component, km/s (default: 150 with flows, 750 with --no-flows); "
            "free: estimated from the residuals"
        ),
    )
    parser.add_argument(
        "--omega-m", type=_fraction, metavar="X", help="matter density of a flat cosmology (default: 0.315)"
    )
    parser.add_argument(
        "--clip",
        type=values.positive,
        metavar="KAPPA",
        help="first leave out sources with residuals of a degree-1 fit larger than KAPPA times the median",
    )
    parser.add_argument(
        "--estimator",
        type=values.method,
        metavar="NAME[=VALUE]",
        help=(
            "of the bins, where they hold no near galaxies: least-squares (default), recommended, clip=KAPPA, student, "
            "permissive or excess-noise"
        ),
    )
    parser.add_argument("--free-spin", action="store_true", help="fit the spin of the frame as well")
    parser.add_argument(
        "--acceleration",
        type=_known_vector,
        metavar="X,Y,Z,ERROR",
        help="the acceleration known from quasars: ICRS, µas/yr (default: free)",
    )
    distances = parser.add_argument_group("redshifts, and flows that galaxies share")
    distances.add_argument(
        "--redshift-frame",
        choices=values.REDSHIFT_FRAMES,
        help="frame of the redshifts, if the table does not specify it; true: cosmological redshifts",
    )
    distances.add_argument("--no-magnitudes", action="store_true", help="distances follow from redshifts alone")
    distances.add_argument(
        "--no-flows",
        action="store_true",
        help="leave out the flows that galaxies share: errors are then several times too small on the real sky",
    )
    distances.add_argument(
        "--flows", action="store_true", help="the default: fit the flow that linear theory expects as well"
    )
    distances.add_argument(
        "--n-modes", type=values.count(3), default=250, metavar="N", help="number of modes of the flow (default: 250)"
    )
    distances.add_argument(
        "--local-group",
        action="store_true",
        help="use the Local Group's velocity as a constraint on the flow at our position (for --velocity)",
    )
    distances.add_argument(
        "--flow-amplitude",
        type=_amplitude,
        metavar="MEAN,SIGMA",
        help=(
            "with --posterior: prior on the flow's amplitude, relative to linear theory, so that the flow constrains H0"
        ),
    )
    distances.add_argument(
        "--reconstruction",
        metavar="FILE",
        help="velocities on a grid, .npz or .npy as 2M++'s; the flow that is fitted is then its error",
    )
    distances.add_argument(
        "--reconstruction-error", type=values.positive, default=0.5, metavar="X", help="of the flow (default: 0.5)"
    )
    measured = parser.add_argument_group("distances that are measured: clusters, masers, stars")
    measured.add_argument(
        "--distances",
        action="store_true",
        help=(
            "fit our velocity with respect to sources at measured distances or parallaxes, without redshifts or H0; in "
            "Galactic axes, or with --frame ecliptic in those"
        ),
    )
    measured.add_argument(
        "--oort", action="store_true", help="with --distances: rotation and shear as well (Oort's A, B, C, K)"
    )
    posterior = parser.add_argument_group("posterior of our velocity and H0")
    posterior.add_argument(
        "--posterior",
        action="store_true",
        help="sample it; prior on the velocity: Planck's or --velocity; on H0: flat, or by --h0-error or --h0-range",
    )
    posterior.add_argument(
        "--method",
        choices=("emcee", "grid"),
        help="a chain (emcee, the default), or independent draws at once, where H0 and one more at most are free",
    )
    posterior.add_argument("--n-samples", type=values.count(1), default=100_000, metavar="N", help="default: 100000")
    posterior.add_argument(
        "--checkpoint", metavar="FILE", help="keep the chain here; an interrupted run resumes from it"
    )
    posterior.add_argument("--h0-error", type=values.positive, metavar="SIGMA", help="prior H0 ± SIGMA (or flat)")
    posterior.add_argument("--h0-range", type=_range, metavar="LOW,HIGH", help="a prior flat between limits")
    posterior.add_argument(
        "--peculiar-dispersion-max",
        type=values.positive,
        metavar="MAX",
        help="dispersion free, flat from 0 to MAX km/s",
    )
    posterior.add_argument("--seed", type=int, default=1, help="the same seed, the same chain (default: 1)")
    parsing.add_threads(parser)
    reading.add_workers(parser)
    reading.add_reading(parser)
    parsing.add_common(parser)
    return parser


def _dispersion(text):
    return text if text == "free" else values.not_negative(text)


def _edges(text):
    edges = values.numbers(text)
    if len(edges) == 1:
        values.count(1)(text)
    elif not all(a < b for a, b in pairwise(edges)):
        raise argparse.ArgumentTypeError(f"edges must rise, not {text!r}")
    return edges


def _range(text):
    limits = values.numbers(text)
    if len(limits) != 2 or not 0 < limits[0] < limits[1]:
        raise argparse.ArgumentTypeError(f"two rising numbers above zero are wanted, not {text!r}")
    return limits


def _fraction(text):
    number = values.positive(text)
    if not 0.001 < number < 2:
        raise argparse.ArgumentTypeError(f"Ω_m must lie between 0.001 and 2, not at {text!r}")
    return number


def _known_vector(text):
    """Three components along ICRS axes, and one error."""
    limits = values.numbers(text)
    if len(limits) != 4 or not limits[3] > 0:
        raise argparse.ArgumentTypeError(f"three components and an error above zero are wanted, not {text!r}")
    return limits


def _amplitude(text):
    limits = values.numbers(text)
    if len(limits) != 2 or not min(limits) > 0:
        raise argparse.ArgumentTypeError(f"a mean and an error above zero are wanted, not {text!r}")
    return limits


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if options.checkpoint and not options.posterior:
        parser.error("--checkpoint is for --posterior")
    if options.checkpoint and options.method == "grid":
        parser.error("--checkpoint keeps a chain: draws from a grid are made at once")
    for name in ("flows", "local_group", "reconstruction", "flow_amplitude"):
        if getattr(options, name) and options.no_flows:
            parser.error(f"--{name.replace('_', '-')} does not go with --no-flows")
    for name, needs in (
        ("flow_amplitude", "posterior"),
        ("local_group", "velocity"),
        ("h0_range", "posterior"),
        ("peculiar_dispersion_max", "posterior"),
        ("h0_error", "posterior"),
        ("method", "posterior"),
    ):
        if getattr(options, name) and not getattr(options, needs):
            parser.error(f"--{name.replace('_', '-')} needs --{needs}")
    wanted = options.h0 or options.velocity or options.bins or options.posterior
    if options.floor and options.lmax == 2:
        parser.error("--floor needs --lmax 3 or more: degrees 1 and 2 say nothing of what bins share")
    for name in ("floor", "no_floor", "estimator"):
        if getattr(options, name) and not options.bins:
            parser.error(f"--{name.replace('_', '-')} is for --bins")
    if options.oort and not options.distances:
        parser.error("--oort needs --distances")
    if options.distances and (wanted or options.workers or options.scheduler or options.clip or options.free_spin):
        parser.error("--distances stands alone: it takes no --h0, --velocity, --bins, --posterior, --clip, --workers")
    if not (wanted or options.distances):
        parser.error("say what is wanted: --h0 H0, --velocity planck, --bins EDGES, --posterior, --distances")
    if (
        options.checkpoint
        and options.output
        and Path(options.output).resolve() in Path(options.checkpoint).resolve().parents
    ):
        parser.error("keep the checkpoint outside the folder of results, which is replaced as a whole")
