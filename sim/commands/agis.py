"""`vsh-agis`: sources and attitude solved together, on the command line."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import sim
import vsh
from sim.commands import calibration_words
from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Answer, Section
from vsh.tools.files import exclusive
from vsh.tools.types import Table
from vsh.tools.units import AU_PER_YEAR, JULIAN_YEAR

#: Sources that a solution has unless told, and the dispersion of their motions about --global. [µas/yr]
_QUASARS, _SCATTER = 5000, 10.0


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-agis",
        description=(
            "Solve quasars, galaxies and stars together with the attitude of the satellite that sees them, by "
            "conjugate gradients. A run that was killed resumes where it stopped when it is started again."
        ),
        examples=(
            "vsh-agis --quasars 20000 --sky igql --exact --output igql",
            "vsh-agis --quasars 2000 --stars 2000 --attitude 10 --output known",
            "vsh-agis --quasars 500000 --plan",
        ),
    )
    add = parsing.adder(parser)
    add("--quasars N", "number of quasars", parsing.count(1), _QUASARS)
    add(
        "--stars N",
        "number of additional stars, with magnitudes drawn from star counts (default: none)",
        parsing.count(0),
        0,
    )
    add("--star-error SIGMA", "error of a star's transit, µas (default: by magnitude)", parsing.positive)
    add("--galaxies N", "number of galaxies (default: none)", parsing.count(0), 0)
    add(
        "--vlbi N",
        "number of quasars with radio positions; if given, the solution is rotated to their frame",
        parsing.count(0),
        0,
    )
    add("--sky", "distribution of the quasars", parsing.SKIES, "uniform")
    add(
        "--knots SECONDS",
        "interval of the knots of the attitude spline, seconds, before scaling",
        parsing.positive,
        30.0,
    )
    add(
        "--no-scaling",
        "do not scale fields of view and knots to the number of sources; half a million sources need no scaling",
        dest="scale",
        action="store_false",
    )
    add("--start RANDOM,SYSTEMATIC", "initial errors of the sources, µas (default: 100000,10000)", _two, (1e5, 1e4))
    add(
        "--attitude solved|SIGMA",
        "solve for the attitude (default), or treat it as known independently with this error, µas",
        _attitude,
        "solved",
    )
    add(
        "--calibration WORDS",
        "solve for the basic angle as well, as 'free every 5 days to order 1' (default: it is known)",
        calibration_words,
    )
    add(
        "--smoothing SIGMA",
        "prior standard deviation of the attitude's second differences, µas: a weak constraint across gaps in the "
        "observations (default: 1e6)",
        parsing.positive,
        1e6,
    )
    add(
        "--global acceleration|DEGREE|velocity",
        "global parameters of the proper motions in the same solution: an acceleration, harmonics up to a degree, or "
        "the velocity of the Solar System",
        _motions,
        dest="motions",
    )
    add(
        "--method",
        "conjugate gradients (default), or the simple iteration, which converges slowly",
        ("conjugate", "simple"),
        "conjugate",
    )
    add("--iterations N", "largest number of iterations", parsing.count(1), 500)
    add("--exact", "also compute the exact errors of spin and acceleration, with six more solutions")
    add("--ccds", "observations in a transit", int, 1, choices=[1, 9])
    add("--variability SIGMA", "variability of the quasars' photocentres, µas", parsing.not_negative, 0.0)
    add("--tau", "correlation time of --variability, yr", parsing.positive, 2.0)
    add("--years", "length of the mission", parsing.positive, 5.0)
    add("--release", "Gaia release whose errors are used", ("DR3", "DR4", "DR5", "paper"), "DR4")
    add(
        "--spin X,Y,Z",
        "true spin that is added to the motions of motions.fits, ICRS, µas/yr",
        parsing.vector,
        (0.0, 0.0, 0.0),
    )
    add(
        "--acceleration X,Y,Z",
        "true acceleration that is added to the motions of motions.fits, ICRS, µas/yr",
        parsing.vector,
        (0.0, 0.0, 0.0),
    )
    add(
        "--map",
        "keep transits, observations and the factored attitude matrix on disk during the run, next to DIR; memory is "
        "then 1.1 kB per source and 0.7 GiB",
    )
    add("--plan", "only print the memory and time that the run would take")
    add("--seed", "seed of the random numbers", int, 1)
    add(
        "--workers --threads N",
        "number of threads (default: one per core); does not affect the results",
        parsing.count(1),
        dest="threads",
    )
    add("--output DIR", "a new folder for report, motions, sources and figures")
    reading.add_figures(parser)
    parsing.add_overwrite(parser)
    parsing.add_common(parser)
    return parser


def _two(text):
    days = parsing.numbers(text)
    if len(days) != 2 or min(days) < 0:
        raise argparse.ArgumentTypeError(f"two numbers that are not negative are expected, not {text!r}")
    return days


def _attitude(text):
    return text if text == "solved" else parsing.positive(text)


def _motions(text):
    if text.isdecimal() and int(text) > 0:
        return int(text)
    if text not in ("acceleration", "velocity"):
        raise argparse.ArgumentTypeError(f"acceleration, velocity or a degree is expected, not {text!r}")
    return text


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if not options.plan and not options.output:
        parser.error("say where results go, --output DIR, or --plan, which only tells what they would take")
    if options.vlbi > options.quasars:
        parser.error(f"--vlbi: {options.vlbi} quasars cannot be chosen from {options.quasars}")
    if options.motions == "velocity" and not options.galaxies:
        parser.error("--global velocity is determined by galaxies: say --galaxies N")


#: Edges of bins of angle, in heights of a field: within it, about it, far beyond.
_ANGLES = np.array([0.0, 0.15, 0.37, 0.73, 1.0, 1.5, 3.0, 7.0])
CAPTIONS = {
    "convergence": "How far the lowest degrees are from where they end, iteration by iteration.",
    "errors": "True over formal errors of the five parameters by magnitude.",
    "correlation": "Correlation of the errors of two parallaxes by the angle between the sources.",
    "map": "True over formal errors of the motions over the sky.",
}


def sections_of(
    system: sim.agis.System,
    solution: sim.agis.AgisSolution,
    notes: list[str],
    mixture: sim.agis.Mixture,
    options: Any,
    exact: dict[str, Any],
) -> list[Section]:
    """Sections of the report."""
    from vsh.io.tables import table_of

    scans = system.scans
    counts = ", ".join(
        f"{np.sum(mixture.are(source_type))} {source_type}"
        for source_type in sim.agis.KINDS
        if mixture.are(source_type).any()
    )
    sigma = np.sqrt(np.einsum("nii->ni", solution.formal))
    attitude = "solved" if system.prior is None else f"known to {system.prior:g} µas"
    convergence = "at rest" if solution.converged else "NOT at rest: large scales are not what they will be"
    facts = [
        ("sources", f"{counts}; {system.solved.sum()} solved"),
        ("transits", f"{len(scans)}, {sim.agis.ACROSS:g} times the error across the scan"),
        ("attitude", f"{scans.intervals} intervals of {scans.spacing * JULIAN_YEAR:.4g} s, {attitude}"),
        ("basic angle", "known" if system.angle is None else f"solved, {system.angle.calibration}"),
        ("iterations", f"{solution.iterations}, {convergence}"),
    ]
    source_types = [source_type for source_type in sim.agis.KINDS if (mixture.are(source_type) & system.solved).any()]
    pulls = []
    for source_type in source_types:
        selection = mixture.are(source_type) & system.solved
        pulls.append(np.sqrt(np.mean((solution.sources[selection] / sigma[selection]) ** 2, axis=0)))
    names = ("α*", "δ", "ϖ", "µα*", "µδ")
    ratios = table_of({"sources": source_types} | dict(zip(names, np.transpose(pulls), strict=True)))
    sections = [
        Section("Sources and attitude solved together", facts, notes=notes),
        Section("True over formal error, this draw of the noise (rms over sources)", (), ratios,
                forms=dict.fromkeys(names, ".3f")),
    ]  # fmt: skip
    if solution.global_parameters is not None and system.motion is not None:
        unit = "km/s for v, else µas/yr" if options.motions == "velocity" else "µas/yr"
        table = table_of({"parameter": list(system.motion.names), "value": solution.global_parameters})
        sections.append(Section(f"Global parameters [{unit}], truth 0", (), table, forms={"value": "+.4f"}))
    if exact:
        errors = np.array(list(exact.values()))
        columns = {"parameter": list(exact), "formal": errors[:, 0], "true": errors[:, 1]}
        columns["ratio"] = errors[:, 1] / errors[:, 0]
        formal, true = np.array([exact[str(mode)] for mode in vsh.Modes(1)][3:]).T
        remarks = [f"acceleration: true/formal {np.sqrt(np.sum(true**2) / np.sum(formal**2)):.3f}"]
        forms = {"formal": ".4f", "true": ".4f", "ratio": ".3f"}
        title = "Exact errors of a fit of degree 1 to the quasars [µas/yr, coefficients]"
        sections.append(Section(title, (), table_of(columns), forms=forms, remarks=remarks))
    return sections


def write(
    folder: Path, solution: sim.agis.AgisSolution, mixture: sim.agis.Mixture, named: Mapping[str, Table], options: Any
) -> None:
    """Write motions, sources and convergence."""
    from vsh.io import tables

    truth = sim.spin(options.spin) + sim.acceleration(options.acceleration)
    motions = solution.field(
        truth, sources=mixture.are("quasars"), redshift=mixture.redshift, magnitude=mixture.magnitude
    )
    meta = {
        f"{name}_{axis}": float(v)
        for name, vector in (("SPIN", options.spin), ("ACC", options.acceleration))
        for axis, v in zip("XYZ", vector, strict=True)
    }
    motions.write(folder / "motions.fits", meta | {"PROGRAM": f"vsh-agis {vsh.__version__}"})
    tables.write_table(named["sources"], folder / "sources.fits", {"UNITS": "muas, muas/yr"})
    tables.write_table(named["convergence"], folder / "convergence.ecsv")


def tables_of(system: sim.agis.System, solution: sim.agis.AgisSolution, mixture: sim.agis.Mixture) -> dict[str, Table]:
    """Errors of every source, and the lowest degrees after every iteration."""
    from vsh.io.tables import table_of

    names = ("ra", "dec", "parallax", "pmra", "pmdec")
    columns = {
        "ra": np.degrees(mixture.lon),
        "dec": np.degrees(mixture.lat),
        "kind": np.array(sim.agis.KINDS)[mixture.kind],
        "transits": system.scans.counts,
    }
    columns |= {f"error_{name}": solution.sources[:, i] for i, name in enumerate(names)}
    columns |= {
        f"sigma_{name}": np.sqrt(np.where(system.solved, solution.formal[:, i, i], np.nan))
        for i, name in enumerate(names)
    }
    history = {str(mode): solution.history[:, i] for i, mode in enumerate(solution.modes)}
    return {
        "convergence": table_of({"iteration": np.arange(1, len(solution.history) + 1)} | history),
        "sources": table_of(columns),
    }


def draw(system: sim.agis.System, solution: sim.agis.AgisSolution, mixture: sim.agis.Mixture) -> dict[str, Any]:
    """Convergence, errors by magnitude, by angle and over the sky: axes by name of file."""
    quasars = mixture.are("quasars") & system.solved
    # Errors in units of their true size, which goes by magnitude.
    sigma = np.sqrt(solution.formal[quasars, 2, 2])
    group = np.floor(2 * mixture.magnitude[quasars]).astype(int)
    group -= group.min()
    size = sigma * sim.agis.ratio_by(solution.sources[quasars, 2], sigma, group)[0][group]
    height = 2 * np.radians(0.342) * np.sqrt(max(1.0, system.scans.spacing * JULIAN_YEAR / 30.0))
    edges = np.minimum(_ANGLES * height, np.pi)
    edges = edges[: np.searchsorted(edges, np.pi) + 1]
    angles = sim.agis.correlation_by_angle(
        solution.sources[quasars, 2], mixture.lon[quasars], mixture.lat[quasars], edges, sigma=size
    )
    nside = 2 ** int(np.clip(np.log2(np.sqrt(quasars.sum() / 120)), 0, 4))
    return {
        "convergence": sim.agis.plot_convergence(solution),
        "errors": sim.agis.plot_errors_by_magnitude(solution, mixture.magnitude, quasars),
        "correlation": sim.agis.plot_correlation(edges, *angles),
        "map": sim.agis.plot_ratio_map(solution, nside, quasars),
    }


#: Noise of a galaxy's transit beyond a star's, as the 2016 paper takes it. [µas]
GALAXIES_EXCESS = 215.0


def _run(options):
    run = None if options.plan else finishing.Run(options)
    # A stream of its own for each step, so that one option does not shift what another draws.
    gaps, sky, galaxies, stars, selection_rng, noise, start, radio = np.random.default_rng(options.seed).spawn(8)
    law = sim.NominalScanningLaw(years=options.years, dead_time=sim.scanning.DEAD_TIME, rng=gaps)
    mission = sim.Mission(law, options.release)
    mixture = sim.agis.mixture(
        mission,
        sim.quasars(options.quasars, sky, options.sky),
        sim.galaxies(options.galaxies, galaxies, "gums") if options.galaxies else None,
        sim.stars(options.stars, stars) if options.stars else None,
        excess_noise=GALAXIES_EXCESS,
        star_error=options.star_error,
    )
    full = sim.agis.FULL if options.scale else None
    if run is None:
        whole_law, knots, _ = sim.agis.as_whole(law, options.quasars, options.knots, full)
        finishing.print_result(
            options,
            finishing.message(str(sim.agis.plan(whole_law, mixture.lon, mixture.lat, knots, ccds=options.ccds))),
        )
        return
    # What a killed run goes on from.
    work = Path(f"{options.output}.unfinished")
    work.mkdir(parents=True, exist_ok=True)
    try:
        with exclusive(work / "checkpoint.npz"):
            _solve(run, law, mixture, full, work, (noise, start, selection_rng, radio))
    finally:
        with suppress(OSError):  # not empty: a checkpoint, or somebody else's files
            work.rmdir()


def _solve(run, law, mixture, full, work, streams):
    """The joint solution, from transits to a folder of results."""
    options = run.options
    noise, start, selection_rng, radio = streams
    quasars = mixture.are("quasars")
    system, notes = sim.agis.joint_system(
        law,
        mixture.lon,
        mixture.lat,
        mixture.sigma,
        knots=options.knots,
        ccds=options.ccds,
        full=full,
        number=options.quasars,
        prior=None if options.attitude == "solved" else options.attitude,
        smoothing=options.smoothing,
        motion=_global(options, mixture),
        calibration=options.calibration,
        folder=work / "scans" if options.map else None,
        progress=True,
    )
    variability = sim.Variability(options.variability, options.tau) if options.variability else None
    observed = sim.agis.observations(system.scans, noise, variability=variability, variable=quasars)
    random, systematic = options.start
    sources, attitude = sim.agis.start_errors(system.scans, start, random=random, systematic=systematic)
    prior_attitude = None
    if system.prior is not None:  # what is known of the attitude is off by as much
        prior_attitude = system.prior * start.standard_normal(attitude.shape)
    solution = system.solve(
        *observed,
        start=sources,
        attitude=attitude,
        known=prior_attitude,
        method=options.method,
        iterations=options.iterations,
        sources=quasars,
        checkpoint=work / "checkpoint.npz",
        progress=True,
    )
    solution, frame_notes = _fix_frame(system, solution, options, quasars, selection_rng, radio)
    exact = _exact(system, mixture) if options.exact else {}
    result_tables = tables_of(system, solution, mixture)
    part = finishing.Part(
        "agis",
        None,
        sections=lambda _: sections_of(system, solution, notes + frame_notes, mixture, options, exact),
        plot=lambda: draw(system, solution, mixture),
        tables=lambda: result_tables,
        files=lambda folder, _: write(folder, solution, mixture, result_tables, options),
    )
    run.finish(
        [part],
        notes=notes + frame_notes,
        answer=Answer(tuple(_answer(system, solution, mixture))),
        title=f"{options.quasars} quasars and the attitude, solved together",
        captions=CAPTIONS,
    )
    (work / "checkpoint.npz").unlink()
    if options.map:
        shutil.rmtree(work / "scans", ignore_errors=True)


def _answer(system, solution, mixture):
    """The line to quote: by how much formal errors are too small, an rms over quasars."""
    quasars = mixture.are("quasars") & system.solved
    sigma = np.sqrt(np.einsum("nii->ni", solution.formal[quasars]))
    pulls = np.sqrt(np.mean((solution.sources[quasars] / sigma) ** 2, axis=0))
    text = f"true errors are {pulls[2]:.2f} (parallaxes) and {np.mean(pulls[3:]):.2f} (motions) times the formal errors"
    remark = "" if solution.converged else "; the iteration is NOT at rest, and large scales are not final"
    return [("errors", f"{text}, rms of {np.sum(quasars)} quasars{remark}")]


def _global(options, mixture):
    """Global motion that quasars, and galaxies, follow."""
    if options.motions is None:
        return None
    factors, scatter = None, np.where(mixture.are("quasars"), _SCATTER, np.inf)
    if options.motions == "velocity":
        from vsh.models.cosmology import transverse_distance

        galaxies = mixture.are("galaxies")
        factors = np.zeros(len(mixture))
        factors[galaxies] = 1 / (AU_PER_YEAR * transverse_distance(mixture.redshift[galaxies]))
        scatter[galaxies] = _SCATTER
    degree = options.motions if isinstance(options.motions, int) else 1
    return sim.agis.global_motion(mixture.lon, mixture.lat, degree, scatter=scatter, factors=factors)


def _exact(system, mixture):
    """Formal and true errors of a fit of degree 1 to the quasars, and of global parameters, by name."""
    modes, quasars = vsh.Modes(1), mixture.are("quasars")
    positions = mixture.lon[quasars], mixture.lat[quasars]
    pairs = zip(
        np.sqrt(np.diag(system.formal_covariance(modes, *positions))),
        np.sqrt(np.diag(system.true_covariance(modes, *positions, progress=True))),
        strict=True,
    )
    rows = {str(mode): pair for mode, pair in zip(modes, pairs, strict=True)}
    if system.motion is not None:
        formal, true = system.global_covariances(progress=True)
        global_errors = zip(system.motion.names, np.sqrt(np.diag(formal)), np.sqrt(np.diag(true)), strict=True)
        rows |= {f"global {name}": tuple(pair) for name, *pair in global_errors}
    return rows


def _fix_frame(system, solution, options, quasars, selection_rng, radio):
    """The solution in a frame of its own, by radio positions and the motions of quasars, and what was done."""
    if options.vlbi:
        indices = np.sort(selection_rng.choice(np.flatnonzero(quasars), options.vlbi, replace=False))
        solution, _, errors = sim.agis.rotate_frame(solution, indices, quasars, rng=radio)
        return solution, [f"{solution.notes[-1]}, formal errors {np.round(errors, 3).tolist()}"]
    rotated_solution = sim.agis.in_own_frame(system, solution)
    return rotated_solution, list(rotated_solution.notes[len(solution.notes) :])


main, run = running.make_entry(__name__, _run)
