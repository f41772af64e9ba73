"""`vsh-agis`: sources and attitude solved together, on the command line."""

from __future__ import annotations

import shutil
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

import sim
import vsh
from sim import agis
from sim.commands._agis_results import CAPTIONS, draw, report, tables_of, write
from vsh.commands import finishing, outputs, running
from vsh.commands.options import agis as words
from vsh.system.files import exclusive
from vsh.units import AU_PER_YEAR


def _run(options):
    if not options.plan:
        outputs.check(options)
    # A stream of its own for each step, so that one option does not shift what another draws.
    gaps, sky, galaxies, stars, chosen, noise, start, radio = np.random.default_rng(options.seed).spawn(8)
    law = sim.NominalScanningLaw(years=options.years, dead_time=options.dead_time, rng=gaps)
    mission = sim.Mission(law, options.release)
    mixture = agis.mixture(
        mission,
        sim.quasars(options.quasars, sky, options.sky),
        sim.galaxies(options.galaxies, galaxies, "gums") if options.galaxies else None,
        sim.stars(options.stars, stars) if options.stars else None,
        excess_noise=215.0,
        star_error=options.star_error,
    )
    full = agis.FULL if options.scale else None
    if options.plan:
        wide, knots, _ = agis.as_whole(law, options.quasars, options.knots, full)
        finishing.tell(options, finishing.Found(agis.plan(wide, mixture.lon, mixture.lat, knots, ccds=options.ccds)))
        return
    # What a killed run goes on from.
    work = Path(f"{options.output}.unfinished")
    work.mkdir(parents=True, exist_ok=True)
    try:
        with exclusive(work / "checkpoint.npz"):
            _solve(options, law, mixture, full, work, (noise, start, chosen, radio))
    finally:
        with suppress(OSError):  # not empty: a checkpoint, or somebody else's files
            work.rmdir()


def _solve(options, law, mixture, full, work, streams):
    """The joint solution, from transits to a folder of results."""
    noise, start, chosen, radio = streams
    quasars = mixture.are("quasars")
    system, notes = agis.joint_system(
        law, mixture.lon, mixture.lat, mixture.sigma, knots=options.knots, across=options.across, ccds=options.ccds, full=full, number=options.quasars,
        prior=None if options.attitude == "solved" else options.attitude, smoothing=options.smoothing,
        motion=_global(options, mixture), folder=work / "scans" if options.map else None, progress=True,
    )  # fmt: skip
    variability = sim.Variability(options.variability, options.tau) if options.variability else None
    observed = agis.observations(system.scans, noise, variability=variability, variable=quasars)
    errors = {"random": options.start[0], "systematic": options.start[1], "attitude": options.start_attitude}
    sources, attitude = agis.start_errors(system.scans, start, **errors)
    known = None
    if system.prior is not None:  # what is known of the attitude is off by as much
        known = system.prior * start.standard_normal(attitude.shape)
    solution = system.solve(
        *observed, start=sources, attitude=attitude, known=known, first=options.first, method=options.method,
        iterations=options.iterations, stop=options.stop, sources=quasars, checkpoint=work / "checkpoint.npz", progress=True,
    )  # fmt: skip
    solution, rotated = _framed(system, solution, options, quasars, chosen, radio)
    exact = _exact(system, mixture) if options.exact else {}
    text = report(system, solution, notes + rotated, mixture, options, exact)
    found = finishing.Found(text, lambda: tables_of(system, solution, mixture), notes + rotated)
    finishing.finish(
        options, found, provenance=lambda: running.provenance([], options),
        draw=lambda: draw(system, solution, mixture), write=lambda folder, meta: write(folder, solution, mixture, found.tables, options),
        title=f"{options.quasars} quasars and the attitude, solved together", captions=CAPTIONS,
    )  # fmt: skip
    (work / "checkpoint.npz").unlink()
    if options.map:
        shutil.rmtree(work / "scans", ignore_errors=True)


def _global(options, mixture):
    """What the motions of quasars, and of galaxies, follow."""
    if options.motions is None:
        return None
    factors, scatter = None, np.where(mixture.are("quasars"), options.scatter, np.inf)
    if options.motions == "velocity":
        from vsh.cosmology import transverse_distance

        galaxies = mixture.are("galaxies")
        factors = np.zeros(len(mixture))
        factors[galaxies] = 1 / (AU_PER_YEAR * transverse_distance(mixture.redshift[galaxies]))
        scatter[galaxies] = options.scatter
    degree = options.motions if isinstance(options.motions, int) else 1
    return agis.global_motion(mixture.lon, mixture.lat, degree, scatter=scatter, factors=factors)


def _exact(system, mixture):
    """Formal and true errors of a fit of degree 1 to the quasars, and of global parameters, by name."""
    modes, quasars = vsh.Modes(1), mixture.are("quasars")
    where = mixture.lon[quasars], mixture.lat[quasars]
    pairs = zip(
        np.sqrt(np.diag(system.formal_covariance(modes, *where))),
        np.sqrt(np.diag(system.true_covariance(modes, *where, progress=True))),
        strict=True,
    )
    found = {str(mode): pair for mode, pair in zip(modes, pairs, strict=True)}
    if system.motion is not None:
        formal, true = system.global_covariances(progress=True)
        named = zip(system.motion.names, np.sqrt(np.diag(formal)), np.sqrt(np.diag(true)), strict=True)
        found |= {f"global {name}": tuple(pair) for name, *pair in named}
    return found


def _framed(system, solution, options, quasars, chosen, radio):
    """The solution in a frame of its own, by radio positions and the motions of quasars, and what was done."""
    if options.vlbi:
        which = np.sort(chosen.choice(np.flatnonzero(quasars), options.vlbi, replace=False))
        solution, _, errors = agis.rotate_frame(solution, which, quasars, rng=radio)
        return solution, [f"{solution.notes[-1]}, formal errors {np.round(errors, 3).tolist()}"]
    turned = agis.in_own_frame(system, solution)
    return turned, list(turned.notes[len(solution.notes) :])


main, run = running.entry(words, _run)

if __name__ == "__main__":
    sys.exit(main())
