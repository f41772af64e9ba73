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
from vsh.tools.files import digest
from vsh.tools.printing import printable

#: Towards the Galactic centre, and towards the apex of the microwave background (Bachchan et al. 2016).
ACCELERATION = "-0.235965,-3.755779,-2.080491"
#: Lengths of mission at which errors of transits give those of a release.
YEARS = {"DR3": 2.8, "DR4": 5.0, "DR5": 10.0, "paper": 5.0}
#: Length of the epochs. [yr]
EPOCH_YEARS = 5.5
KINDS = ("quasars", "galaxies", "vlbi", "crf3", "crf4", "epochs", "link")
#: Kinds that take an option, of those that not all take.
_KINDS_OF_OPTION = {
    "velocity": ("galaxies",), "flow": ("galaxies",), "orientation": ("vlbi", "link"), "wave": ("epochs",),
    "traps": ("crf3", "crf4"), **dict.fromkeys(("redshifts", "positions", "columns", "units"), ("quasars", "galaxies")),
    **dict.fromkeys(("sky", "errors", "release"), ("quasars", "galaxies", "vlbi", "epochs")),
    **dict.fromkeys(("spin", "acceleration"), tuple(kind for kind in KINDS if kind != "vlbi")),
}  # fmt: skip
#: The Hubble constant of simulated galaxies. [km/s/Mpc]
HUBBLE = 67.3


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
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
    add_option = parsing.adder(parser)
    add_option(
        "kind",
        "what is simulated | vlbi: offsets from radio positions, as motions; "
        "crf3: a whole Gaia-CRF3 in the archive's columns; crf4: the same with the columns, epoch, errors and models "
        "of DR4; epochs: every transit of quasars in the columns of DR4's epoch astrometry; link: radio stars in Gaia "
        "and VLBI, for vsh-link",
        KINDS,
    )
    add_option(
        "--number N",
        "number of sources (default: 10000; link: 40; crf3, crf4: 1215942) | of crf3 and crf4 those with five "
        "parameters, to which about a third more with six parameters are added",
        parsing.count(1),
    )
    parsing.adder(parsing.get_shared_group(parser))(
        "--output FILE", "table to write: FITS, ECSV, CSV, VOTable or Parquet", required=True
    )
    parsing.add_overwrite(parser)
    add_option(
        "--positions FILE",
        "quasars, galaxies: table to use instead of drawn ones | of positions, redshifts and magnitudes, which are "
        "drawn where it has none",
    )
    reading.add_columns(parser, "the table of --positions")
    add_option(
        "--sky NAME|MAP",
        f"distribution of the sources: {', '.join(parsing.SKIES)} or a map | uniform unless given; a "
        "HEALPix map (FITS), galactic:FILE where its header does not state its axes",
    )
    add_option("--spin X,Y,Z", "true spin, ICRS, µas/yr (default: none)", parsing.parse_vector, (0.0, 0.0, 0.0))
    add_option(
        "--acceleration X,Y,Z",
        "true acceleration, ICRS, µas/yr (default: 4.3 towards the Galactic centre)",
        parsing.parse_vector,
        parsing.parse_vector(ACCELERATION),
    )
    add_option("--orientation X,Y,Z", "vlbi, link: true orientation, ICRS, µas", parsing.parse_vector, (0.0, 0.0, 0.0))
    add_option(
        "--velocity planck|SPEED,L,B",
        "galaxies: true velocity of the Solar System | km/s toward Galactic degrees; 0 unless given, so that no "
        "secular parallax is simulated; with --flow linear that of the flow where we are, and the Sun's in the Local "
        "Group",
        parsing.parse_velocity,
    )
    add_option(
        "--flow linear|SIGMA",
        "galaxies: peculiar velocities | those of linear theory, a dispersion in km/s, or both, as linear,250",
        _check_flow_words,
        action=parsing.JoinValues,
    )
    add_option(
        "--redshifts",
        "of the expansion alone (true), or observed | those have velocities in them",
        ("true", "heliocentric", "cmb"),
        "true",
    )
    add_option(
        "--errors",
        "errors from every transit, expected by place, or with a solved attitude | expected: by place and magnitude; "
        "solved: together with the sources",
        ("transits", "expected", "solved"),
        "transits",
    )
    add_option("--release", "release whose errors are simulated", ("DR3", "DR4", "DR5", "paper"), "DR4")
    add_option(
        "--traps",
        "crf3, crf4: with systematic errors | and stars among the quasars, and faint errors that are too small",
    )
    add_option(
        "--wave F,PLUS,CROSS,L,B",
        "epochs: a gravitational wave of frequency F per year | strains in µas, toward ICRS degrees L, B",
        parsing.parse_numbers,
    )
    add_option("--seed", "seed", int, 1)
    return parsing.add_common(parser, "list of what was written")


def _list_foreign(kind):
    """The options that a kind does not take."""
    return [name for name, kinds in _KINDS_OF_OPTION.items() if kind not in kinds]


def narrow(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Hide the options that the kind among the `words` does not take, for its --help."""
    kind = next((argument for argument in words if not argument.startswith("-")), None)
    for action in parser._actions if kind in KINDS else ():
        if action.dest in _list_foreign(kind):
            action.help = argparse.SUPPRESS


def _check_flow_words(words):
    """Return the words on flows, "linear" and a dispersion between commas, if they can be read."""
    for word in words.split(","):
        if word != "linear":
            parsing.parse_not_negative(word)
    return words


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself; a number that nobody gave is set."""
    if options.positions and (options.number is not None or options.sky):
        parser.error("--positions takes the sources of a table: --number and --sky draw others")
    if options.sigma or ((options.columns or options.units) and not options.positions):
        parser.error("--columns and --units are of the table of --positions, whose errors are simulated")
    foreign_names = [name for name in _list_foreign(options.kind) if getattr(options, name) != parser.get_default(name)]
    if foreign_names:
        takers = " and ".join(_KINDS_OF_OPTION[foreign_names[0]])
        parser.error(f"--{foreign_names[0]} does not go with {options.kind}: --{foreign_names[0]} is for {takers}")
    if options.wave is not None and (len(options.wave) != 5 or options.wave[0] <= 0):
        parser.error("--wave is a frequency above zero, plus, cross, and a direction, as 2,100,0,30,-20")
    if options.errors == "expected" and options.kind in ("vlbi", "epochs"):
        parser.error(f"--errors expected leaves out the transits, of which {options.kind} consist")
    if options.number is None and options.kind not in ("crf3", "crf4"):
        options.number = {"epochs": 500, "link": 40}.get(options.kind, 10_000)
    flow_words = (options.flow or "").split(",")
    options.dispersion = next((float(word) for word in reversed(flow_words) if word not in ("", "linear")), 0.0)
    options.flow = "linear" if "linear" in flow_words else None


def _run(options):
    vsh.io.tables.check_writable(options.output)  # what cannot be written is better told before the work than after
    finishing.check_file(options.output, options.overwrite)
    finishing.check_configuration_replaceable(options.output)
    writers = {"crf3": _write_crf_catalogue, "crf4": _write_crf_catalogue, "epochs": _write_epochs, "link": _write_link}
    writers.get(options.kind, _write_catalogue)(options)


def _write_catalogue(options):
    """Write the motions of quasars or galaxies, or offsets from radio positions."""
    # A stream of its own for each step, so that one option does not shift what another draws.
    sky_rng, vlbi_rng, gap_rng, observation_rng, velocity_rng = np.random.default_rng(options.seed).spawn(5)
    population, notes = (
        _read_population(options, sky_rng) if options.positions else (_draw_population(options, sky_rng, vlbi_rng), [])
    )
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    given_velocity = reading.make_observer_velocity(options.velocity)
    velocity, group_velocity = np.zeros(3) if given_velocity is None else given_velocity.to_frame("icrs").value, None
    if options.kind == "galaxies":
        if options.dispersion or options.flow:
            motions = sim.peculiar(options.dispersion, velocity_rng, flow=options.flow, hubble=HUBBLE)
            if options.flow and given_velocity is None:  # we take part in it
                group_velocity = next(part for part in motions.parts if hasattr(part, "velocity_here")).velocity_here(
                    population.redshift
                )
                velocity = group_velocity + vsh.models.cosmology.SUN_IN_LOCAL_GROUP.to_frame("icrs").value
            signal += motions
        if velocity.any():
            signal += sim.secular_parallax(velocity, hubble=HUBBLE)
    law = sim.NominalScanningLaw(years=YEARS[options.release], dead_time=sim.scanning.DEAD_TIME, rng=gap_rng)
    mission = sim.Mission(law, options.release, "solved" if options.errors == "solved" else 10.0)
    true_vectors = {"SPIN": options.spin, "ACC": options.acceleration}
    if options.kind == "vlbi":  # offsets [µas] have an orientation; spin and acceleration are of motions
        true_vectors = {"ORIENT": options.orientation}
        field = sim.observe_offsets(population, sim.spin(options.orientation), observation_rng, mission)
    elif options.errors == "expected":
        from sim.expected import errors_by_place

        sigma, rho = errors_by_place(population.magnitude, population.lon, population.lat, mission)
        field = sim.observe(population, signal, observation_rng, sigma=sigma, rho=rho, redshifts=options.redshifts)
    else:
        field = sim.observe(population, signal, observation_rng, mission=mission, redshifts=options.redshifts)
    meta = _make_truth_metadata(true_vectors, options)
    if options.kind == "galaxies":
        meta |= {f"VEL_{axis}": float(value) for axis, value in zip("XYZ", velocity, strict=True)}
        meta["HUBBLE"] = HUBBLE
        if group_velocity is not None:
            meta |= {f"GROUP_{axis}": float(value) for axis, value in zip("XYZ", group_velocity, strict=True)}
        field = vsh.models.cosmology.with_redshift(field)  # our own default output is what our own default input takes
    field.write(options.output, meta, overwrite=options.overwrite)  # another run may have written it meanwhile
    notes += field.notes
    if options.kind == "vlbi":
        notes.append("note: pmra and pmdec are offsets, mas for mas/yr: the spin of a fit is their orientation, in µas")
    if vsh.io.tables.format_of(options.output) == "ascii.csv":
        notes.append("note: CSV has no place for the truth; FITS, ECSV, VOTable and Parquet keep it with the table")
    _finish(options, notes, meta, f"{len(field)} sources")


def _write_crf_catalogue(options):
    """A catalogue in the archive's own columns."""
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    count_options = {} if options.number is None else {"n_five": options.number}
    table = getattr(sim, options.kind)(options.seed, signal, traps=options.traps, **count_options)
    truth = _make_truth_metadata({"SPIN": options.spin, "ACC": options.acceleration}, options)
    vsh.io.tables.write_table(table, options.output, truth, overwrite=options.overwrite)
    parameter_codes = table["astrometric_params_solved" if options.kind == "crf3" else "astrometric_params"]
    n_five, n_six = (int(np.sum(parameter_codes == value)) for value in (31, 95))
    n_other = len(table) - n_five - n_six
    suffix = f", {n_other} with another model" if n_other else ""
    _finish(options, [], dict(table.meta) | truth, f"{n_five} sources with five parameters, {n_six} with six{suffix}")


def _write_epochs(options):
    """Write the transits of quasars, in the columns of DR4's epoch astrometry."""
    sky_rng, gap_rng, observation_rng = np.random.default_rng(options.seed).spawn(3)
    population = _draw_population(options, sky_rng, sky_rng)
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    true_values = {"SPIN": options.spin, "ACC": options.acceleration}
    if options.wave:
        frequency, plus, cross, lon, lat = options.wave
        signal += sim.wave_in_time(vsh.Vector.from_spherical(1.0, lon, lat).value, frequency, plus, cross)
        true_values["WAVE"] = options.wave
    law = sim.NominalScanningLaw(years=EPOCH_YEARS, dead_time=sim.scanning.DEAD_TIME, rng=gap_rng)
    attitude, mission = "solved" if options.errors == "solved" else "perfect", sim.Mission(law, options.release, 10.0)
    table = sim.epochs(population, signal, observation_rng, mission=mission, attitude=attitude, complete=True)
    truth = {f"{name}_{i}": float(value) for name, values in true_values.items() for i, value in enumerate(values)}
    vsh.io.tables.write_table(
        table, options.output, truth | {"ATTITUDE": attitude, "SEED": options.seed}, overwrite=options.overwrite
    )
    _finish(options, [], truth, f"{len(table)} transits of {len(population)} quasars, attitude {attitude}")


def _write_link(options):
    """Radio stars, and quasars, in Gaia and VLBI."""
    from vsh.io.astrometry import write_astrometry

    rows = sim.link(
        options.seed, options.number, orientation=options.orientation, spin=options.spin,
        aberration=vsh.Vector(np.array(options.acceleration), np.zeros((3, 3))),
    )  # fmt: skip
    vectors = {"ORIENT": options.orientation, "SPIN": options.spin, "JUMP": (0.0,) * 3, "ACC": options.acceleration}
    meta = _make_truth_metadata(vectors, options)
    write_astrometry(rows, options.output, meta, overwrite=options.overwrite)
    _finish(options, [], meta, f"{len(rows)} rows of {options.number} stars, gaia and vlbi")


def _finish(options, notes, meta, summary):
    """Write the configuration that repeats the run, and print what was written."""
    finishing.write_configuration(options, {Path(options.output).name: digest(options.output)})
    named_values = [(name, float(value)) for name, value in meta.items() if isinstance(value, (int, float))]
    truth_line = ", ".join(f"{name} {value:g}" for name, value in named_values)
    message = "\n".join([*notes, f"written to {options.output}: {summary}", f"truth: {truth_line}"])

    def make_truth_table():
        return {"truth": vsh.io.tables.table_of_rows(("name", "value"), named_values)}

    finishing.print_result(options, finishing.make_message_result(message, make_truth_table, notes))


def _make_truth_metadata(vectors, options):
    """Metadata with the truth of the table."""
    meta = {
        f"{name}_{axis}": float(value)
        for name, vector in vectors.items()
        for axis, value in zip("XYZ", vector, strict=True)
    }
    return meta | {"PROGRAM": f"vsh-sim {vsh.__version__}", "OPTIONS": json.dumps(_select_recorded_options(options))}


def _draw_population(options, rng, vlbi_rng):
    sky, frame = options.sky or "uniform", "icrs"
    if sky not in parsing.SKIES:
        from vsh.sky.pixels import count_missing_pixels

        sky, frame = reading.read_map_and_frame(sky)
        n_empty = count_missing_pixels(sky)
        if n_empty:
            finishing.print_line(
                options, f"note: {n_empty} of {sky.size} pixels of {options.sky} have no value and hold no sources"
            )
    if options.kind == "galaxies":
        return sim.galaxies(options.number, rng, sky, map_frame=frame)
    if options.kind == "vlbi":
        return sim.vlbi_quasars(
            sim.quasars(max(options.number, 500_000), rng, sky, map_frame=frame), options.number, vlbi_rng
        )
    return sim.quasars(options.number, rng, sky, map_frame=frame)


def _read_population(options, rng):
    """The sources of a user's own table, and what is to be said of them."""
    from vsh.tools.notes import ASSUMED_MOTIONS, UNUSED_CORRELATIONS, has_code

    facts = {"units": options.units, "frame": options.catalogue_frame, "format": options.input_format}
    sources = vsh.io.catalogue.read_sources(options.positions, options.columns, on_bad="drop", sigma=1.0, **facts)
    sources = sources.to_frame("icrs")
    motion_codes = (ASSUMED_MOTIONS, UNUSED_CORRELATIONS)  # which are made here
    notes = [note for note in sources.notes if not has_code(note, *motion_codes)]
    if options.kind == "galaxies":
        if sources.redshift is None:
            raise TableError(
                f"{printable(options.positions)} has no redshifts, from which galaxies have their distances: if a "
                "column holds them, say --columns redshift=NAME"
            )
        reading.refuse_velocities(sources.notes, printable(options.positions))
        usable_sources = vsh.models.cosmology.with_redshift(sources)
        notes += usable_sources.notes[len(sources.notes) :]
        sources = usable_sources
    n = len(sources)
    if n == 0:
        raise TableError(f"{printable(options.positions)} holds no source that can be simulated")
    magnitude = sources.magnitude
    is_missing = np.ones(n, bool) if magnitude is None else ~np.isfinite(magnitude)
    if is_missing.any():
        if options.kind == "galaxies":
            drawn_magnitudes = sim.population.magnitudes_at(np.asarray(sources.redshift, float), rng)
        else:
            drawn_magnitudes = np.asarray(sim.quasars(n, rng).magnitude, float)
        magnitude = drawn_magnitudes if magnitude is None else np.where(is_missing, drawn_magnitudes, magnitude)
        suffix = " at these redshifts" if options.kind == "galaxies" else ""
        notes.append(f"{is_missing.sum()} of {n} magnitudes drawn as of simulated {options.kind}" + suffix)
    return sim.Population(sources.lon, sources.lat, magnitude, sources.redshift), notes


def _select_recorded_options(options):
    """All options but those that change nothing."""
    excluded_names = [*running.NOT_TOLD, *(_list_foreign(options.kind) if options.kind in ("crf3", "crf4") else ())]
    settings = {key: value for key, value in vars(options).items() if key not in excluded_names}
    if options.velocity is not None:
        velocity = reading.make_observer_velocity(options.velocity)
        assert velocity is not None
        settings["velocity"] = [velocity.amplitude, *velocity.to_frame("galactic").direction]
    return settings


main, run = running.make_entry(__name__, _run)
