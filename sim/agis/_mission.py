"""A mission whose attitude is solved from what it sees: from a population to a joint solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.agis._globals import GlobalMotion
from sim.agis._observations import observations
from sim.agis._system import ROUGH, System
from sim.agis.passes import FULL, check_memory, plan, scaled, scans
from sim.agis.results import AgisSolution
from sim.variability import Variability
from vsh.checks.arguments import generator
from vsh.checks.types import ArrayLike, BoolArray, FloatArray, Rng

#: Errors across the scan, in errors along: Gaia's windows are wider than long, and most are binned across.
ACROSS = 5.0


def joint_system(
    law: Any, lon: FloatArray, lat: FloatArray, sigma: FloatArray, *, knots: float = 30.0, across: float = ACROSS,
    ccds: int = 1, full: int | None = FULL, number: int | None = None, prior: float | None = None, smoothing: float = 1e6, motion: GlobalMotion | None = None,
    folder: Any = None, threads: int | None = None, progress: bool = False,
) -> tuple[System, list[str]]:  # fmt: skip
    """The normal equations of a mission, scaled to the number of its sources.

    Parameters
    ----------
    law : NominalScanningLaw
        Of the whole mission.
    lon, lat : (n,) arrays
        Positions in its frame. [rad]
    sigma : (n,) array
        Errors of a transit along the scan. [µas]
    knots : float
        Of the whole mission. [s]
    across : float
        Errors across the scan, in those along.
    ccds : {1, 9}
        Observations in a transit.
    full : int or None
        Sources that the whole mission would have: with fewer its fields are wider and its knots farther apart, as in
        AGISLab. None scales nothing.
    number : int, optional
        Sources that the mission is scaled by, as quasars where stars are seen beside them; all unless given.
    prior, smoothing, motion
        As of `System`.
    folder, threads, progress
        As of `scans`.

    Returns
    -------
    system : System
    notes : list of str
        What a reader of the result should know.
    """
    law, knots, notes = as_whole(law, number or len(lon), knots, full)
    told = plan(law, lon, lat, knots, ccds=ccds)
    # All of it before the work begins; transits on disk need no memory of their own.
    check_memory(told.memory_on_disk if folder else told.memory, "the joint solution",
                 "take fewer sources, or knots farther apart")  # fmt: skip
    if smoothing < ROUGH:
        notes.append(
            f"smoothing of {smoothing:g} µas is a statement on the attitude: errors hold only where it bends no more"
        )
    found = scans(law, lon, lat, sigma, across * np.asarray(sigma), knots, ccds=ccds, folder=folder, threads=threads, progress=progress)  # fmt: skip
    return System(found, prior, smoothing=smoothing, motion=motion, threads=threads), notes


def as_whole(law: Any, n: int, knots: float, full: int | None = FULL) -> tuple[Any, float, list[str]]:
    """The law and knots of a mission, scaled if it has fewer sources than the whole one."""
    if full is None or n >= full:
        return law, knots, []
    law, knots = scaled(n, law, knots=knots, full=full)
    height = np.degrees(2 * law.half_height)
    said = f"mission scaled to {n} sources as if they were {full}: fields {height:.2f}° high, knots {knots:.4g} s apart"
    return law, knots, [said]


def solve_mission(
    law: Any, lon: FloatArray, lat: FloatArray, sigma: FloatArray, rng: Rng, *, variability: Variability | None = None,
    variable: BoolArray | None = None, sources: ArrayLike | None = None, progress: bool = False, **options: Any,
) -> tuple[AgisSolution, System, list[str]]:  # fmt: skip
    """Observe the sources of a mission and solve for them and the attitude.

    Parameters
    ----------
    law, lon, lat, sigma
        As of `joint_system`.
    rng : Generator or int
        The source of all randomness.
    variability, variable
        As of `observations`.
    sources : indices, optional
        Whose large scales must come to rest; all unless given.
    progress : bool
        Show bars, after two seconds.
    **options
        Others of `joint_system`.

    Returns
    -------
    solution : AgisSolution
        In the frame in which its sources do not turn, on average, against the truth.
    system : System
    notes : list of str
    """
    system, notes = joint_system(law, lon, lat, sigma, progress=progress, **options)
    along, across = observations(system.scans, generator(rng), variability=variability, variable=variable)
    solution = system.solve(along, across, sources=sources, progress=progress)
    return in_own_frame(system, solution), system, notes


def in_own_frame(system: System, solution: AgisSolution) -> AgisSolution:
    """The solution in the frame in which its sources do not turn, on average, against the truth.

    Parameters
    ----------
    system : System
        Whose solution it is.
    solution : AgisSolution
        In any frame.

    Returns
    -------
    AgisSolution
        The same where an attitude is known, and with it the frame.
    """
    if not system.defect:
        return solution
    kept = np.where(system.solved[:, None], solution.sources, 0.0)[..., None]
    rotation = np.zeros(6)
    rotation[: system.defect] = system.without_null_space(kept)[1][:, 0]
    return solution.rotated(
        rotation[:3], rotation[3:], "frame: that in which the sources do not turn against the truth"
    )
