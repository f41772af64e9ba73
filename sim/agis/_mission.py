"""A mission whose attitude is solved from what it sees: from a population to a joint solution."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.agis._calibration import Calibration
from sim.agis._globals import GlobalMotion, make_source_slices
from sim.agis._results import AgisSolution
from sim.agis._system import SMOOTHING_LIMIT, System
from sim.agis.passes import FULL, Scans, check_memory, plan, scaled, scans
from sim.mission import Mission
from sim.population import Population
from sim.variability import Variability, markov_chain
from vsh.basis import harmonics
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray, Rng


@arguments.accepts(scans=arguments.a(Scans), rng=arguments.seed)
def observations(
    scans: Scans, rng: Rng, *, variability: Variability | None = None, variable: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Observations less what the true parameters make of them: noise, and photocentres that vary.

    Parameters
    ----------
    scans : Scans
        The transits.
    rng : Generator or int
        The source of all randomness.
    variability : Variability, optional
        Variability of the photocentres, at every transit.
    variable : (n,) bool array, optional
        Which sources vary; all unless given.

    Returns
    -------
    along, across : (k,) arrays
        Across scan of no weight where nothing is measured; on disk where the transits are. [µas]
    """
    noise_rng, chain_rng = generator(rng).spawn(2)
    with np.errstate(divide="ignore"):
        sigma = 1 / np.sqrt(scans.weights)
    sigma[~np.isfinite(sigma)] = 0.0
    along, across = (scans.array(len(scans)) for _ in range(2))
    for component, source_sigma in zip((along, across), sigma, strict=True):
        for block in scans.blocks():
            component[block] = noise_rng.standard_normal(block.stop - block.start) * source_sigma[scans.source[block]]
    if variability is not None and variability.sigma > 0:
        time_order = np.argsort(scans.source, kind="stable")  # of a source, in the order of time
        if variable is not None:
            time_order = time_order[np.asarray(variable, bool)[scans.source[time_order]]]
        source, times = scans.source[time_order], scans.time()[time_order]
        east, north = (markov_chain(times, variability.sigma, variability.tau, chain_rng, source) for _ in range(2))
        sin, cos = (column[time_order].astype(float) for column in (scans.sin, scans.cos))
        along[time_order] += sin * east + cos * north
        across[time_order] += sin * north - cos * east
    return along, across


def start_errors(
    scans: Scans, rng: Rng, *, random: float = 1e5, systematic: float = 1e4, attitude: float = 10.0
) -> tuple[FloatArray, FloatArray]:
    """Errors with which a solution begins; those of Bachchan, Hobbs & Lindegren (2016, section 4) unless given."""
    rng = generator(rng)
    source_errors = random * rng.standard_normal((scans.n_sources, 5))
    modes = Modes(3)
    coefficients, fields = rng.standard_normal((2, len(modes))), np.empty((2, 2, scans.n_sources))
    for chunk in make_source_slices(scans.n_sources):
        fields[..., chunk] = np.tensordot(coefficients, harmonics(scans.lon[chunk], scans.lat[chunk], modes), 1)
    for columns, field in zip((slice(0, 2), slice(3, 5)), fields, strict=True):
        source_errors[:, columns] += systematic * (field / np.sqrt(np.mean(np.sum(field**2, 0)))).T
    return source_errors, attitude * rng.standard_normal((scans.intervals + 3, 3))


#: Errors across the scan, in errors along: Gaia's windows are wider than long, and most are binned across.
ACROSS = 5.0


def joint_system(
    law: Any,
    lon: FloatArray,
    lat: FloatArray,
    sigma: FloatArray,
    *,
    knots: float = 30.0,
    across: float = ACROSS,
    ccds: int = 1,
    full: int | None = FULL,
    number: int | None = None,
    prior: float | None = None,
    smoothing: float = 1e6,
    motion: GlobalMotion | None = None,
    calibration: Calibration | str | None = None,
    folder: Any = None,
    threads: int | None = None,
    progress: bool = False,
) -> tuple[System, list[str]]:
    """The normal equations of a mission, scaled to the number of its sources.

    Parameters
    ----------
    law : NominalScanningLaw
        Scanning law of the whole mission.
    lon, lat : (n,) arrays
        Positions in its frame. [rad]
    sigma : (n,) array
        Errors of a transit along the scan. [µas]
    knots : float
        Interval of the knots over the whole mission. [s]
    across : float
        Errors across the scan, in those along.
    ccds : {1, 9}
        Observations in a transit.
    full : int or None
        Sources that the whole mission would have: with fewer its fields are wider and its knots farther apart, as in
        AGISLab. None scales nothing.
    number : int, optional
        Sources that the mission is scaled by, as quasars where stars are seen beside them; all unless given.
    prior, smoothing, motion, calibration
        As of `System`.
    folder, threads, progress
        As of `scans`.

    Returns
    -------
    system : System
    notes : list of str
        What a reader of the result should know.
    """
    law, knots, notes = scale_mission(law, number or len(lon), knots, full)
    sigma = np.asarray(sigma)
    cost = plan(law, lon, lat, knots, ccds=ccds)
    # All of it before the work begins; transits on disk need no memory of their own.
    check_memory(
        cost.memory_on_disk if folder else cost.memory,
        "the joint solution",
        "take fewer sources, or knots farther apart",
    )
    if smoothing < SMOOTHING_LIMIT:
        notes.append(
            f"smoothing of {smoothing:g} µas is a statement on the attitude: errors are right where it bends no more"
        )
    mission_scans = scans(
        law, lon, lat, sigma, across * sigma, knots, ccds=ccds, folder=folder, threads=threads, progress=progress
    )
    system = System(mission_scans, prior, smoothing=smoothing, motion=motion, threads=threads, calibration=calibration)
    return system, notes


def scale_mission(law: Any, n: int, knots: float, full: int | None = FULL) -> tuple[Any, float, list[str]]:
    """The law and knots of a mission, scaled if it has fewer sources than the whole one."""
    if full is None or n >= full:
        return law, knots, []
    law, knots = scaled(n, law, knots=knots, full=full)
    height = np.degrees(2 * law.half_height)
    note = f"mission scaled to {n} sources as if they were {full}: fields {height:.2f}° high, knots {knots:.4g} s apart"
    return law, knots, [note]


def solve_mission(
    law: Any,
    lon: FloatArray,
    lat: FloatArray,
    sigma: FloatArray,
    rng: Rng,
    *,
    variability: Variability | None = None,
    variable: BoolArray | None = None,
    sources: ArrayLike | None = None,
    progress: bool = False,
    **options: Any,
) -> tuple[AgisSolution, System, list[str]]:
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
        Sources whose large scales must come to rest; all unless given.
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
    """The solution in the frame in which its sources do not turn, on average, against the truth."""
    if not system.defect:
        return solution
    parameters = np.where(system.solved[:, None], solution.sources, 0.0)[..., None]
    rotation = np.zeros(6)
    rotation[: system.defect] = system.without_null_space(parameters)[1][:, 0]
    return solution.rotated(rotation[:3], rotation[3:], "frame: that in which sources do not turn against the truth")


KINDS = ("quasars", "galaxies", "stars")


@dataclass(frozen=True, eq=False)
class Mixture(Frozen):
    """Sources of several kinds, one after the other: quasars first.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions. [rad]
    sigma : (n,) array
        Errors of a transit along the scan. [µas]
    magnitude, redshift : (n,) arrays
        nan where unknown.
    kind : (n,) int array
        Index into KINDS.
    """

    lon: FloatArray
    lat: FloatArray
    sigma: FloatArray
    magnitude: FloatArray
    redshift: FloatArray
    kind: IntArray

    def __len__(self) -> int:
        return len(self.lon)

    def are(self, kind: str) -> BoolArray:
        """Mask of the sources of a `kind`, (n,): quasars, galaxies or stars."""
        return self.kind == KINDS.index(arguments.choice("kind", kind, KINDS))


@arguments.accepts(mission=arguments.a(Mission), quasars=arguments.a(Population))
def mixture(
    mission: Mission,
    quasars: Population,
    galaxies: Population | None = None,
    stars: Population | None = None,
    *,
    excess_noise: ArrayLike = 0.0,
    star_error: float | None = None,
) -> Mixture:
    """The sources of a mission with the errors of their transits.

    Parameters
    ----------
    mission : Mission
        Mission whose errors are taken, by magnitude.
    quasars, galaxies, stars : Population
        In the mission's frame, with magnitudes.
    excess_noise : float or array
        Excess noise of galaxies that are no points. [µas]
    star_error : float, optional
        Error of a star's transit; by magnitude unless given. The attitude is held by the weight Σ 1/σ². [µas]

    Raises
    ------
    ParameterError
        If one has no magnitudes.
    FrameError
        If one is in another frame.
    """
    column_sets = []
    for kind, population in enumerate((quasars, galaxies, stars)):
        if population is None:
            continue
        mission.check_frame(population.frame)
        n = len(population)
        if population.magnitude is None:
            raise ParameterError(f"errors of transits go by magnitude, and the {KINDS[kind]} have none")
        sigma = mission.transit_error(population.magnitude, excess_noise if KINDS[kind] == "galaxies" else 0.0)
        if KINDS[kind] == "stars" and star_error is not None:
            sigma = np.full(n, arguments.positive("star_error", star_error))
        redshift = np.full(n, np.nan) if population.redshift is None else population.redshift
        column_sets.append((population.lon, population.lat, sigma, population.magnitude, redshift, np.full(n, kind)))
    mixed_sources = Mixture(*(np.concatenate(column) for column in zip(*column_sets, strict=True)))
    arguments.float_array("sigma", mixed_sources.sigma)
    return mixed_sources
