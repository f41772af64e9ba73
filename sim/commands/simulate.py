"""`vsh-sim`: a simulated catalogue with a known truth, on the command line."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import sim
import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.tools.errors import TableError
from vsh.tools.files import atomic_write, digest
from vsh.tools.printing import printable

#: Towards the Galactic centre, and towards the apex of the microwave background (Bachchan et al. 2016).
ACCELERATION = "-0.235965,-3.755779,-2.080491"
#: Lengths of mission at which errors of transits give those of a release.
YEARS = {"DR3": 2.8, "DR4": 5.0, "DR5": 10.0, "paper": 5.0}
#: What positions along scan take of the other kinds' options.
NOT_OF_EPOCHS = ("no_transits", "variability", "velocity", "redshifts", "redshift_error", "orientation")
NOT_OF_CRF3 = (
    "sky", "selection", "map_frame", "orientation", "velocity", "peculiar_dispersion", "flow", "redshifts",
    "redshift_error", "variability", "attitude", "excess_noise", "years", "redshift_range", "release",
    "no_transits", "wave", "columns", "units",
)  # fmt: skip
#: What radio stars take of the other kinds' options, and what is theirs alone.
NOT_OF_LINK = (*(each for each in NOT_OF_CRF3 if each != "orientation"), "tau")
OF_LINK = ("jump", "binaries", "single", "quasars")
#: Options of galaxies alone.
OF_GALAXIES = ("velocity", "h0", "peculiar_dispersion", "flow", "redshift_range")


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
    add = parsing.adder(parser)
    add(
        "kind",
        "vlbi: offsets from radio positions, as motions; crf3: a whole Gaia-CRF3 in the archive's columns; crf4: the "
        "same with the columns, epoch, errors and models of DR4; epochs: every transit of quasars in the columns of "
        "DR4's epoch astrometry; link: radio stars in Gaia and VLBI, for vsh-link",
        ("quasars", "galaxies", "vlbi", "crf3", "crf4", "epochs", "link"),
    )
    add(
        "--number N",
        "number of sources (default: 10000; link: 40; crf3, crf4: 1215942, the sources with five parameters, to which "
        "about a third more with six parameters are added)",
        parsing.count(1),
    )
    add("--output FILE", "table to write: FITS, ECSV, CSV, VOTable or Parquet", required=True)
    parsing.add_overwrite(parser)
    add(
        "--positions FILE",
        "quasars, galaxies: table with positions, redshifts and magnitudes to use instead of drawn ones (magnitudes "
        "are drawn where it has none)",
    )
    add("--columns ROLE=NAME,…", "names of the columns of --positions: redshift=cz", parsing.columns)
    add("--units NAME=UNIT,…", "units of the columns of --positions: cz=km/s", parsing.pairs)
    add("--sky", "distribution of the sources on the sky (default: uniform)", parsing.SKIES)
    add("--selection MAP", "HEALPix map (FITS) of the density of the sources")
    add("--map-frame", "frame of the map (default: that of its header, or icrs)", ("icrs", "galactic", "ecliptic"))
    add("--spin X,Y,Z", "true spin, ICRS, µas/yr (default: none)", parsing.vector, (0.0, 0.0, 0.0))
    add(
        "--acceleration X,Y,Z",
        "true acceleration, ICRS, µas/yr (default: 4.3 towards the Galactic centre)",
        parsing.vector,
        parsing.vector(ACCELERATION),
    )
    add("--orientation X,Y,Z", "vlbi, link: true orientation, ICRS, µas", parsing.vector, (0.0, 0.0, 0.0))
    add(
        "--jump X,Y,Z",
        "link: difference of the spin of sources fainter than G = 13, µas/yr",
        parsing.vector,
        (0.0, 0.0, 0.0),
    )
    add("--binaries", "link: share of binaries", parsing.fraction, 0.1)
    add("--single SHARE", "link: share of stars with single epochs of VLBI", parsing.fraction, 0.0)
    add("--quasars N", "link: number of quasars in addition to the stars", parsing.count(0), 0)
    add(
        "--velocity planck|SPEED,L,B",
        "galaxies: true velocity of the Solar System, km/s toward Galactic degrees (default: 0, so no secular parallax "
        "is simulated; with --flow that of the flow where we are, and the Sun's in the Local Group)",
        parsing.velocity,
    )
    add("--h0", "true Hubble constant, km/s/Mpc", parsing.positive, 67.3)
    add(
        "--peculiar-dispersion SIGMA",
        "galaxies: dispersion of peculiar velocities in each component, km/s",
        parsing.not_negative,
        0.0,
    )
    add("--flow", "galaxies: add the coherent flow of linear theory", ("linear",))
    add(
        "--redshifts",
        "redshifts of the expansion alone, or observed ones with velocities",
        ("true", "heliocentric", "cmb"),
        "true",
    )
    add("--redshift-error SIGMA", "error of the redshifts, or spectroscopic, photometric", _redshift_error, 0.0)
    add("--variability SIGMA", "variability of photocentres, µas", parsing.not_negative, 0.0)
    add("--tau", "correlation time of the variability, yr", parsing.positive, 2.0)
    add(
        "--attitude SIGMA|solved",
        "noise of the attitude, µas (default: 10), or solved together with the sources",
        _attitude,
        10.0,
    )
    add("--excess-noise SIGMA", "noise added to every transit, µas", parsing.not_negative, 0.0)
    add(
        "--years",
        "length of the mission (default: that of the release, "
        f"{', '.join(f'{name} {years:g}' for name, years in YEARS.items())})",
        parsing.positive,
    )
    add("--redshift-range LOW,HIGH", "galaxies: range of redshifts (default: 0.001,0.03)", _range)
    add("--release", "release whose errors are simulated", ("DR3", "DR4", "DR5", "paper"), "DR4")
    add(
        "--table",
        "crf4: table of DR4, with the best model of each source or the core solution of all",
        parsing.ASTROMETRY,
        "gaia_source",
    )
    add("--traps", "crf3, crf4: with systematic errors, stars among the quasars, and faint errors that are too small")
    add(
        "--wave F,PLUS,CROSS,L,B",
        "epochs: gravitational wave of frequency F per year, with strains in µas, toward ICRS degrees L, B",
        parsing.numbers,
    )
    add("--no-transits", "simulate errors by place and magnitude, without transits")
    add("--seed", "seed", int, 1)
    parsing.add_threads(parser)
    parsing.add_common(parser, "list of what was written")
    return parser


def narrow(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Hide the options that the kind among the `words` does not take, for its --help."""
    kind = next((argument for argument in words if not argument.startswith("-")), None)
    orbits = (*OF_GALAXIES, "orientation")
    foreign = {
        "quasars": orbits,
        "vlbi": OF_GALAXIES,
        "galaxies": ("orientation",),
        "epochs": (*NOT_OF_EPOCHS, *orbits),
    }
    foreign |= {"link": (*NOT_OF_LINK, "h0", "positions"), "crf3": NOT_OF_CRF3, "crf4": NOT_OF_CRF3}
    own_options = {"link": OF_LINK, "crf4": ("table",), "epochs": ("wave",)}
    if kind not in ("crf3", "crf4"):
        own_options["crf3, crf4"] = ("traps",)
    hidden_options = {
        *foreign.get(kind or "", ()),
        *(name for owner, names in own_options.items() if owner != kind for name in names),
    }
    for action in parser._actions if kind in foreign else ():
        if action.dest in hidden_options:
            action.help = argparse.SUPPRESS


def _range(text):
    lower, *upper = parsing.numbers(text)
    if len(upper) != 1 or not 0 < lower < upper[0]:
        raise argparse.ArgumentTypeError(f"two rising redshifts above zero are expected, not {text!r}")
    return lower, upper[0]


def _attitude(text):
    return text if text == "solved" else parsing.not_negative(text)


def _redshift_error(text):
    return text if text in parsing.REDSHIFT_ERRORS else parsing.not_negative(text)


def _foreign(parser, options, names):
    """Options among `names` that were given, as they are typed."""
    option_names = [name for name in names if getattr(options, name) != parser.get_default(name)]
    return [f"--{name.replace('_', '-')}" for name in option_names]


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself; a number that nobody gave is set."""
    if options.selection and options.sky:
        parser.error("--sky and --selection exclude each other")
    if options.positions:
        flags = [f"--{name}" for name in ("number", "sky", "selection") if getattr(options, name) is not None]
        if flags or options.redshift_range:
            parser.error(
                f"--positions takes the sources of a table: {', '.join(flags) or '--redshift-range'} draws others"
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


def _run(options):
    from vsh.io import tables

    tables.check_writable(options.output)  # what cannot be written is better told before the work than after
    finishing.check_file(options.output, options.overwrite)
    finishing.check_configuration(_repeats(options))
    if options.kind in ("crf3", "crf4"):
        _frame(options)
        return
    if options.kind in ("epochs", "link"):
        (_epochs if options.kind == "epochs" else _link)(options)
        return
    # A stream of its own for each step, so that one option does not shift what another draws.
    sky, selection_rng, gaps, observed, noise = np.random.default_rng(options.seed).spawn(5)
    population, notes = (
        _simulate_own(options, sky) if options.positions else (_population(options, sky, selection_rng), [])
    )
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    ours = reading.velocity_of(options.velocity)
    velocity, group = np.zeros(3) if ours is None else ours.to_frame("icrs").value, None
    if options.kind == "galaxies":
        if options.peculiar_dispersion or options.flow:
            motions = sim.peculiar(options.peculiar_dispersion, noise, flow=options.flow, hubble=options.h0)
            if options.flow and ours is None:  # we take part in it
                from vsh.models.cosmology import SUN_IN_LOCAL_GROUP

                group = next(part for part in motions.parts if hasattr(part, "here")).here(population.redshift)
                velocity = group + SUN_IN_LOCAL_GROUP.to_frame("icrs").value
            signal += motions
        if velocity.any():
            signal += sim.secular_parallax(velocity, hubble=options.h0)
    law = sim.NominalScanningLaw(years=options.years, dead_time=sim.scanning.DEAD_TIME, rng=gaps)
    variability = sim.Variability(options.variability, options.tau) if options.variability else None
    mission = sim.Mission(law, options.release, options.attitude)
    common = {"variability": variability, "threads": options.threads}
    redshift_options = {"redshifts": options.redshifts, "redshift_error": options.redshift_error}
    if options.kind == "vlbi":
        truth = sim.spin(options.orientation)
        field = sim.observe_offsets(population, truth, observed, mission, **common)
    elif options.no_transits:
        from sim.expected import errors_by_place

        sigma, rho = errors_by_place(population.magnitude, population.lon, population.lat, mission)
        field = sim.observe(population, signal, observed, sigma=sigma, rho=rho, **redshift_options)
    else:
        field = sim.observe(
            population,
            signal,
            observed,
            mission=mission,
            excess_noise=options.excess_noise,
            **common,
            **redshift_options,
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
        if group is not None:
            meta |= {f"GROUP_{axis}": float(value) for axis, value in zip("XYZ", group, strict=True)}
    if options.kind == "galaxies":  # our own default output is what our own default input takes
        from vsh.models.cosmology import with_redshift

        field = with_redshift(field)
    field.write(options.output, meta, overwrite=options.overwrite)  # another run may have written it meanwhile
    notes += field.notes
    if tables.format_of(options.output) == "ascii.csv":
        notes.append("note: CSV has no place for the truth; FITS, ECSV, VOTable and Parquet keep it with the table")
    _finish(options, notes, meta, f"{len(field)} sources")


def _frame(options):
    """A catalogue in the archive's own columns."""
    from vsh.io import tables

    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    counts = {} if options.number is None else {"n_five": options.number}
    if options.kind == "crf3":
        table = sim.crf3(options.seed, signal, traps=options.traps, **counts)
    else:
        table = sim.crf4(options.seed, signal, table=options.table, traps=options.traps, **counts)
    truth = _truth({"SPIN": options.spin, "ACC": options.acceleration}, options)
    tables.write_table(table, options.output, truth, overwrite=options.overwrite)
    params = table["astrometric_params_solved" if options.kind == "crf3" else "astrometric_params"]
    five, six = (int(np.sum(params == value)) for value in (31, 95))
    n_other = len(table) - five - six
    suffix = f", {n_other} with another model" if n_other else ""
    _finish(options, [], dict(table.meta) | truth, f"{five} sources with five parameters, {six} with six{suffix}")


def _epochs(options):
    """Write the transits of quasars, in the columns of DR4's epoch astrometry."""
    from vsh.io import tables
    from vsh.vector import Vector

    sky, gaps, observed = np.random.default_rng(options.seed).spawn(3)
    population = _population(options, sky, sky)
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    meta = {"SPIN": options.spin, "ACC": options.acceleration}
    if options.wave:
        frequency, plus, cross, lon, lat = options.wave
        signal += sim.wave_in_time(Vector.from_spherical(1.0, lon, lat).value, frequency, plus, cross)
        meta["WAVE"] = options.wave
    law = sim.NominalScanningLaw(years=options.years, dead_time=sim.scanning.DEAD_TIME, rng=gaps)
    attitude = "solved" if options.attitude == "solved" else "perfect"
    mission = sim.Mission(law, options.release, 10.0 if attitude == "solved" else options.attitude)
    table = sim.epochs(
        population,
        signal,
        observed,
        mission=mission,
        excess_noise=options.excess_noise,
        attitude=attitude,
        complete=True,
        threads=options.threads,
    )
    truth = {f"{name}_{i}": float(value) for name, values in meta.items() for i, value in enumerate(values)}
    tables.write_table(
        table, options.output, truth | {"ATTITUDE": attitude, "SEED": options.seed}, overwrite=options.overwrite
    )
    _finish(options, [], truth, f"{len(table)} transits of {len(population)} quasars, attitude {attitude}")


def _link(options):
    """Radio stars, and quasars, in Gaia and VLBI."""
    from vsh.io.astrometry import write_astrometry
    from vsh.vector import Vector

    rows = sim.link(
        options.seed, options.number, orientation=options.orientation, spin=options.spin, jump=options.jump,
        binaries=options.binaries, single=options.single, quasars=options.quasars,
        aberration=Vector(np.array(options.acceleration), np.zeros((3, 3))),
    )  # fmt: skip
    vectors = {"ORIENT": options.orientation, "SPIN": options.spin, "JUMP": options.jump, "ACC": options.acceleration}
    meta = _truth(vectors, options)
    write_astrometry(rows, options.output, meta, overwrite=options.overwrite)
    summary = f"{len(rows)} rows of {options.number} stars and {options.quasars} quasars, gaia and vlbi"
    _finish(options, [], meta, summary)


def _finish(options, notes, meta, summary):
    """The configuration that repeats it, and what is said."""
    with atomic_write(_repeats(options), overwrite=True) as temporary_path:
        digests = {Path(options.output).name: digest(options.output)}
        temporary_path.write_text(
            finishing.repeats(options, name=_repeats(options).name, written=digests), encoding="utf-8"
        )
    true = ", ".join(f"{name} {value:g}" for name, value in meta.items() if isinstance(value, (int, float)))
    text = "\n".join([*notes, f"written to {options.output}: {summary}", f"truth: {true}"])

    def truth():
        from vsh.io.tables import table_of

        numbers = {name: value for name, value in meta.items() if isinstance(value, (int, float))}
        return {
            "truth": table_of({"name": np.array(list(numbers), str), "value": np.array(list(numbers.values()), float)})
        }

    finishing.print_result(options, finishing.message(text, truth, notes))


def _repeats(options):
    """Path of the configuration: its name with run.toml for the ending."""
    path = Path(options.output)
    return path.with_name(f"{path.name}.{parsing.NAME}")


def _truth(vectors, options):
    """Metadata with the truth of the table."""
    meta = {
        f"{name}_{axis}": float(value)
        for name, vector in vectors.items()
        for axis, value in zip("XYZ", vector, strict=True)
    }
    return meta | {"PROGRAM": f"vsh-sim {vsh.__version__}", "OPTIONS": json.dumps(_plain(options))}


def _population(options, rng, selection_rng):
    sky, frame = options.sky or "uniform", "icrs"
    if options.selection:
        from vsh.io.maps import read_map_of
        from vsh.sky.pixels import missing_pixels

        sky, frame = read_map_of(options.selection, options.map_frame, "--map-frame galactic, or which it is")
        empty = missing_pixels(sky)
        if empty:
            finishing.print_line(
                options, f"note: {empty} of {sky.size} pixels of {options.selection} have no value and hold no sources"
            )
    if options.kind == "galaxies":
        lower, upper = options.redshift_range or (0.001, 0.03)
        return sim.galaxies(options.number, rng, sky, map_frame=frame, min_redshift=lower, max_redshift=upper)
    if options.kind == "vlbi":
        return sim.vlbi_quasars(
            sim.quasars(max(options.number, 500_000), rng, sky, map_frame=frame), options.number, selection_rng
        )
    return sim.quasars(options.number, rng, sky, map_frame=frame)


def _simulate_own(options, rng):
    """The sources of a user's own table, and what is to be said of them."""
    from vsh.io.catalogue import read_sources
    from vsh.models.cosmology import with_redshift
    from vsh.tools.notes import ASSUMED_MOTIONS, UNUSED_CORRELATIONS, has_code

    read = read_sources(options.positions, options.columns, options.units, on_bad="drop", sigma=1.0).to_frame("icrs")
    of_motions = (ASSUMED_MOTIONS, UNUSED_CORRELATIONS)  # which are made here
    notes = [note for note in read.notes if not has_code(note, *of_motions)]
    if options.kind == "galaxies":
        if read.redshift is None:
            raise TableError(
                f"{printable(options.positions)} has no redshifts, from which galaxies have their distances: if a "
                "column holds them, say --columns redshift=NAME (--units NAME=km/s of c z)"
            )
        reading.refuse_velocities(read.notes, printable(options.positions))
        usable_sources = with_redshift(read)
        notes += usable_sources.notes[len(read.notes) :]
        read = usable_sources
    n = len(read)
    if n == 0:
        raise TableError(f"{printable(options.positions)} holds no source that can be simulated")
    magnitude = read.magnitude
    is_missing = np.ones(n, bool) if magnitude is None else ~np.isfinite(magnitude)
    if is_missing.any():
        if options.kind == "galaxies":
            draws = sim.population.magnitudes_at(np.asarray(read.redshift, float), rng)
        else:
            draws = np.asarray(sim.quasars(n, rng).magnitude, float)
        magnitude = draws if magnitude is None else np.where(is_missing, draws, magnitude)
        at = " at these redshifts" if options.kind == "galaxies" else ""
        notes.append(f"{is_missing.sum()} of {n} magnitudes drawn as of simulated {options.kind}" + at)
    return sim.Population(read.lon, read.lat, magnitude, read.redshift), notes


def _plain(options):
    """All options but those that change nothing."""
    exclusions = [*running.NOT_TOLD, "threads"]
    if options.kind in ("crf3", "crf4"):
        exclusions += [*NOT_OF_CRF3, "h0", "tau"]
    settings = {key: value for key, value in vars(options).items() if key not in exclusions}
    if options.velocity is not None:
        ours = reading.velocity_of(options.velocity)
        assert ours is not None
        settings["velocity"] = [ours.amplitude, *ours.to_frame("galactic").direction]
    return settings


main, run = running.make_entry(__name__, _run)
