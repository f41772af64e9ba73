"""`vsh-sim`: a simulated catalogue with a known truth, on the command line."""

import json
from pathlib import Path

import numpy as np

import sim
import vsh
from sim.expected import errors_by_place
from vsh.commands import configuration, finishing, outputs, reading, running
from vsh.commands.options import simulate as options_module
from vsh.tools.errors import TableError
from vsh.tools.files import atomic_write, digest
from vsh.tools.printing import printable


def _run(options):
    from vsh.io import tables

    tables.check_writable(options.output)  # what cannot be written is better told before the work than after
    outputs.check_file(options.output, options.overwrite, recorded=True)
    outputs.check_file(_repeats(options), options.overwrite)  # its configuration, which also has its hash
    if options.kind in ("crf3", "crf4"):
        _frame(options)
        return
    if options.kind in ("epochs", "link"):
        (_epochs if options.kind == "epochs" else _link)(options)
        return
    # A stream of its own for each step, so that one option does not shift what another draws.
    sky, chosen, gaps, observed, noise = np.random.default_rng(options.seed).spawn(5)
    population, notes = _own(options, sky) if options.positions else (_population(options, sky, chosen), [])
    signal = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    ours = reading.velocity_of(options.velocity)
    velocity = np.zeros(3) if ours is None else ours.to_frame("icrs").value
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
    if options.kind == "galaxies":  # our own default output is what our own default input takes
        from vsh.models.cosmology import with_redshift

        field = with_redshift(field)
    field.write(options.output, meta)
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
    tables.write_table(table, options.output, truth)
    params = table["astrometric_params_solved" if options.kind == "crf3" else "astrometric_params"]
    five, six = (int(np.sum(params == value)) for value in (31, 95))
    other = len(table) - five - six
    more = f", {other} with another model" if other else ""
    _finish(options, [], dict(table.meta) | truth, f"{five} sources with five parameters, {six} with six{more}")


def _epochs(options):
    """Every transit of quasars, in the columns of DR4's epoch astrometry."""
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
    law = sim.NominalScanningLaw(years=options.years, dead_time=options.dead_time, rng=gaps)
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
    tables.write_table(table, options.output, truth | {"ATTITUDE": attitude, "SEED": options.seed})
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
    write_astrometry(rows, options.output, meta)
    what = f"{len(rows)} rows of {options.number} stars and {options.quasars} quasars, gaia and vlbi"
    _finish(options, [], meta, what)


def _finish(options, notes, meta, what):
    """The configuration that repeats it, and what is said."""
    with atomic_write(_repeats(options)) as new:
        written = {Path(options.output).name: digest(options.output)}
        new.write_text(outputs.repeats(options, name=_repeats(options).name, written=written), encoding="utf-8")
    true = ", ".join(f"{name} {value:g}" for name, value in meta.items() if isinstance(value, (int, float)))
    text = "\n".join([*notes, f"written to {options.output}: {what}", f"truth: {true}"])

    def truth():
        from vsh.io.tables import table_of

        numbers = {name: value for name, value in meta.items() if isinstance(value, (int, float))}
        return {
            "truth": table_of({"name": np.array(list(numbers), str), "value": np.array(list(numbers.values()), float)})
        }

    finishing.print_result(options, finishing.RunResult(text, truth, notes))


def _repeats(options):
    """Beside the table: its name with run.toml for the ending."""
    path = Path(options.output)
    return path.with_name(f"{path.name}.{configuration.NAME}")


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
        from vsh.io.maps import read_map
        from vsh.sky.pixels import missing_pixels

        sky, named = read_map(options.selection)
        empty = missing_pixels(sky)
        if empty:
            finishing.print_line(
                options, f"note: {empty} of {sky.size} pixels of {options.selection} have no value and hold no sources"
            )
        frame = options.map_frame or named or "icrs"
    if options.kind == "galaxies":
        low, high = options.redshift_range or (0.001, 0.03)
        return sim.galaxies(options.number, rng, sky, map_frame=frame, min_redshift=low, max_redshift=high)
    if options.kind == "vlbi":
        return sim.vlbi_quasars(
            sim.quasars(max(options.number, 500_000), rng, sky, map_frame=frame), options.number, chosen
        )
    return sim.quasars(options.number, rng, sky, map_frame=frame)


def _own(options, rng):
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
        known = with_redshift(read)
        notes += known.notes[len(read.notes) :]
        read = known
    n = len(read)
    if n == 0:
        raise TableError(f"{printable(options.positions)} holds no source that can be simulated")
    magnitude = read.magnitude
    unknown = np.ones(n, bool) if magnitude is None else ~np.isfinite(magnitude)
    if unknown.any():
        if options.kind == "galaxies":
            drawn = sim.population.magnitudes_at(np.asarray(read.redshift, float), rng)
        else:
            drawn = np.asarray(sim.quasars(n, rng).magnitude, float)
        magnitude = drawn if magnitude is None else np.where(unknown, drawn, magnitude)
        at = " at these redshifts" if options.kind == "galaxies" else ""
        notes.append(f"{unknown.sum()} of {n} magnitudes drawn as of simulated {options.kind}" + at)
    return sim.Population(read.lon, read.lat, magnitude, read.redshift), notes


def _plain(options):
    """All options but those that change nothing."""
    other = [*running.NOT_TOLD, "threads"]
    if options.kind in ("crf3", "crf4"):
        other += [*options_module.NOT_OF_CRF3, "h0", "tau"]
    kept = {key: value for key, value in vars(options).items() if key not in other}
    if options.velocity is not None:
        ours = reading.velocity_of(options.velocity)
        assert ours is not None
        kept["velocity"] = [ours.amplitude, *ours.to_frame("galactic").direction]
    return kept


main, run = running.make_entry(options_module, _run)
