"""`vsh-sim`: a simulated catalogue with a known truth, on the command line."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

import numpy as np

import sim
import vsh
from sim.expected import errors_by_place
from sim.observe import REDSHIFT_ERRORS
from vsh.commands import outputs, parsing, running

#: Towards the Galactic centre, and towards the apex of the microwave background (Bachchan et al. 2016).
ACCELERATION = "-0.235965,-3.755779,-2.080491"


_NOT_OF_CRF3 = (
    "sky", "selection", "map_frame", "orientation", "velocity", "peculiar_dispersion", "flow", "redshifts", "redshift_error", "variability", "attitude", "excess_noise",
    "years", "dead_time", "release", "no_transits",
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-sim`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if options.selection and options.sky:
        parser.error("--sky and --selection exclude each other")
    if options.velocity is not None and options.kind != "galaxies":
        parser.error("--velocity is for galaxies: quasars are too far to show it")
    if options.flow and options.kind != "galaxies":
        parser.error("--flow is for galaxies: quasars are too far to show it")
    if options.kind == "crf3":
        foreign = [
            f"--{name.replace('_', '-')}" for name in _NOT_OF_CRF3 if getattr(options, name) != parser.get_default(name)
        ]
        if foreign:
            parser.error(f"crf3 is as it is: {', '.join(foreign)} cannot be chosen")
    elif options.number is None:
        options.number = 10_000
    if options.attitude == "solved" and options.no_transits:
        parser.error("--attitude solved needs transits, which --no-transits leaves out")
    if options.variability and options.no_transits:
        parser.error("--variability needs transits, which --no-transits leaves out")
    return running.guarded("vsh-sim", lambda: _run(options), options.threads)


def _run(options):
    from vsh import catalogue, tables

    tables.check_writable(options.output)  # what cannot be written is better told before the work than after
    outputs.check_file(options.output, options.overwrite)
    if options.kind == "crf3":
        _crf3(options)
        return
    # A stream of its own for each step, so that one option does not shift what another draws.
    sky, chosen, gaps, observed, noise = np.random.default_rng(options.seed).spawn(5)
    population = _population(options, sky, chosen)
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    velocity = np.zeros(3) if options.velocity is None else options.velocity.to_frame("icrs").value
    if options.kind == "galaxies":
        if velocity.any():
            signal += sim.secular_parallax(velocity, hubble=options.h0)
        if options.peculiar_dispersion or options.flow:
            signal += sim.peculiar(options.peculiar_dispersion, noise, flow=options.flow, hubble=options.h0)
    law = sim.NominalScanningLaw(years=options.years, dead_time=options.dead_time, rng=gaps)
    variability = sim.Variability(options.variability, options.tau) if options.variability else None
    mission = sim.Mission(law, options.release, options.attitude)
    common = {"variability": variability, "threads": options.threads}
    seen = {"redshifts": options.redshifts, "redshift_error": options.redshift_error}
    if options.kind == "vlbi":
        truth = sim.spin(options.orientation)
        field = sim.observe_offsets(population, truth, observed, mission, **common)
    elif options.no_transits:
        sigma, rho = errors_by_place(population.magnitude, population.lon, population.lat, mission)
        field = sim.observe(population, signal, observed, sigma=sigma, rho=rho, **seen)
    else:
        field = sim.observe(
            population, signal, observed, mission=mission, excess_noise=options.excess_noise, **common, **seen
        )
    # Offsets [µas] have an orientation; spin and acceleration are of motions.
    true = (
        {"ORIENT": options.orientation}
        if options.kind == "vlbi"
        else {"SPIN": options.spin, "ACC": options.acceleration}
    )
    meta = _truth(true, options)
    if options.kind == "galaxies":
        meta |= {f"VEL_{axis}": float(value) for axis, value in zip("XYZ", velocity, strict=True)}
        meta["HUBBLE"] = options.h0
    catalogue.write_field(field, options.output, meta)
    for note in field.notes:
        running.say(note)
    if tables.format_of(options.output) == "ascii.csv":
        running.say("note: CSV has no place for the truth; FITS, ECSV, VOTable and Parquet keep it with the table")
    running.say(f"written to {options.output}: {len(field)} sources")


def _crf3(options):
    """A catalogue in the archive's own columns."""
    from vsh import tables

    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    counts = {} if options.number is None else {"n_five": options.number}
    table = sim.crf3(options.seed, signal, **counts)
    tables.write_table(table, options.output, _truth({"SPIN": options.spin, "ACC": options.acceleration}, options))
    five = int(np.sum(table["astrometric_params_solved"] == 31))
    running.say(f"written to {options.output}: {five} sources with five parameters, {len(table) - five} with six")


def _truth(vectors, options):
    """What the table's metadata say it was made with."""
    meta = {
        f"{name}_{axis}": float(value)
        for name, vector in vectors.items()
        for axis, value in zip("XYZ", vector, strict=True)
    }
    return meta | {"PROGRAM": f"vsh-sim {vsh.__version__}", "OPTIONS": json.dumps(_plain(options))}


def _population(options, rng, chosen):
    sky, frame = options.sky or "uniform", "icrs"
    if options.selection:
        from vsh.sky.pixels import missing_pixels, read_map

        sky, named = read_map(options.selection)
        empty = missing_pixels(sky)
        if empty:
            running.say(f"note: {empty} of {sky.size} pixels of {options.selection} have no value and hold no sources")
        frame = options.map_frame or named or "icrs"
    if options.kind == "galaxies":
        return sim.galaxies(options.number, rng, sky, map_frame=frame)
    if options.kind == "vlbi":
        return sim.vlbi_quasars(
            sim.quasars(max(options.number, 500_000), rng, sky, map_frame=frame), options.number, chosen
        )
    return sim.quasars(options.number, rng, sky, map_frame=frame)


def _plain(options):
    """All options but those that change nothing."""
    kept = {
        key: value for key, value in vars(options).items() if key not in ("output", "threads", "overwrite", "command")
    }
    if options.velocity is not None:
        kept["velocity"] = [options.velocity.amplitude, *options.velocity.to_frame("galactic").direction]
    return kept


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-sim",
        description="Simulate quasars or galaxies as Gaia sees them: every transit of a five-year mission, photocentres "
        "that vary, five-parameter solutions. The table is one that vsh-fit reads; its metadata hold the truth.",
        epilog="Example: vsh-sim quasars --number 500000 --sky igql --variability 100 --tau 2 --seed 1 --output quasars.fits",
    )
    parser.add_argument(
        "kind", choices=["quasars", "galaxies", "vlbi", "crf3"],
        help="vlbi: offsets from radio positions, as motions; crf3: a whole Gaia-CRF3 in the archive's columns"
    )  # fmt: skip
    parser.add_argument(
        "--number",
        type=parsing.count(1),
        metavar="N",
        help="how many (default: 10000; crf3: 1215942 with five parameters, and those with six in proportion)",
    )
    parser.add_argument("--output", required=True, metavar="FILE", help="FITS, ECSV, CSV, VOTable or Parquet")
    parsing.add_overwrite(parser)
    parser.add_argument("--sky", choices=["uniform", "plane-avoiding", "gums", "igql"], help="default: uniform")
    parser.add_argument("--selection", metavar="MAP", help="a HEALPix map (FITS) of their density")
    parser.add_argument(
        "--map-frame", choices=["icrs", "galactic", "ecliptic"], help="of the map; its header's, or icrs"
    )
    parser.add_argument(
        "--spin", type=parsing.vector, default=(0.0, 0.0, 0.0), metavar="X,Y,Z", help="ICRS, µas/yr (default: none)"
    )
    parser.add_argument(
        "--acceleration", type=parsing.vector, default=parsing.vector(ACCELERATION), metavar="X,Y,Z",
        help="ICRS, µas/yr (default: 4.3 towards the Galactic centre)",
    )  # fmt: skip
    parser.add_argument(
        "--orientation", type=parsing.vector, default=(0.0, 0.0, 0.0), metavar="X,Y,Z", help="vlbi: ICRS, µas"
    )
    parser.add_argument(
        "--velocity",
        type=parsing.velocity,
        metavar="planck|SPEED,L,B",
        help="galaxies: ours, km/s toward Galactic degrees",
    )
    parser.add_argument("--h0", type=parsing.positive, default=67.3, help="km/s/Mpc (default: 67.3)")
    parser.add_argument(
        "--peculiar-dispersion",
        type=parsing.not_negative,
        default=0.0,
        metavar="SIGMA",
        help="galaxies: dispersion, km/s",
    )
    parser.add_argument("--flow", choices=["linear"], help="galaxies: add the flow of linear theory, which they share")
    parser.add_argument(
        "--redshifts", choices=["true", "heliocentric", "cmb"], default="true",
        help="of the expansion alone, or as they are seen, with velocities in them (default: true)",
    )  # fmt: skip
    parser.add_argument(
        "--redshift-error", type=_redshift_error, default=0.0, metavar="SIGMA", help="or spectroscopic, photometric"
    )
    parser.add_argument(
        "--variability", type=parsing.not_negative, default=0.0, metavar="SIGMA", help="of photocentres, µas"
    )
    parser.add_argument("--tau", type=parsing.positive, default=2.0, help="its correlation time, yr (default: 2)")
    parser.add_argument(
        "--attitude",
        type=_attitude,
        default=10.0,
        metavar="SIGMA|solved",
        help="noise, µas (default: 10); or solved together with the sources, see vsh-agis",
    )
    parser.add_argument(
        "--excess-noise", type=parsing.not_negative, default=0.0, metavar="SIGMA", help="added to every transit, µas"
    )
    parser.add_argument("--years", type=parsing.positive, default=5.0, help="length of the mission (default: 5)")
    parser.add_argument(
        "--dead-time", type=parsing.not_negative, default=0.06, metavar="FRACTION", help="default: 0.06"
    )
    parser.add_argument("--release", choices=["DR3", "DR4", "DR5", "paper"], default="DR4", help="whose errors")
    parser.add_argument("--no-transits", action="store_true", help="errors by place and magnitude, without transits")
    parser.add_argument("--seed", type=int, default=1, help="the same seed, the same table (default: 1)")
    parsing.add_threads(parser)
    parser.add_argument("--version", action="version", version=f"vsh-sim {vsh.__version__}")
    return parser


def _attitude(text):
    return text if text == "solved" else parsing.not_negative(text)


def _redshift_error(text):
    return text if text in REDSHIFT_ERRORS else parsing.not_negative(text)


if __name__ == "__main__":
    sys.exit(main())
