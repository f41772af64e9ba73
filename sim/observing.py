"""A true field, seen through noise."""

from dataclasses import replace
from typing import Literal

import numpy as np

from sim.agis import solve_mission
from sim.astrometry import COMPONENTS, gaia_errors, solve_astrometry, split_covariance
from sim.mission import Mission, as_mission
from sim.population import Population
from sim.scanning import BLOCK, NominalScanningLaw
from sim.signal import Signal, as_signal
from sim.variability import Variability
from vsh import Field
from vsh.coefficients import Coefficients
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ParameterError
from vsh.tools.printing import log_calls
from vsh.tools.types import ArrayLike, Release, Rng

#: Errors of redshifts by name: at z = 0, and for each unit of z.
REDSHIFT_ERRORS = {"spectroscopic": (1e-4, 0.0), "photometric": (0.015, 0.015)}


@log_calls("observed")
@arguments.accepts(population=arguments.a(Population), rng=arguments.seed)
def observe(
    population: Population,
    signal: Signal | Coefficients,
    rng: Rng,
    *,
    mission: Mission | NominalScanningLaw | None = None,
    attitude: Literal["solved"] | float | None = None,
    variability: Variability | None = None,
    excess_noise: ArrayLike = 0.0,
    quote_variability: bool = False,
    sigma: ArrayLike | None = None,
    rho: ArrayLike = 0.0,
    release: Release = "DR3",
    redshifts: Literal["true", "heliocentric", "cmb"] = "true",
    redshift_error: ArrayLike | Literal["spectroscopic", "photometric"] = 0.0,
    threads: int | None = None,
    progress: bool = True,
) -> Field:
    """Draw a field whose expectation is the signal.

    Parameters
    ----------
    population : Population
        Where the sources are and how bright.
    signal : Signal or Coefficients
        The true motions, in the population's frame. [µas/yr]
    rng : Generator or int
        The source of all randomness; there is no other. The number of threads changes nothing.
    mission : Mission or NominalScanningLaw, optional
        Simulate every transit of every source over it, and solve for five parameters. A bare scanning law
        has the errors of `release` and an attitude known to 10 µas.
    attitude : float or "solved", optional
        In place of the mission's: known to so many µas, each source then solved for itself, which is right where stars
        hold the attitude; or solved together with the sources (`sim.agis`), as if they were half a million. A mission
        of five years unless one is given.
    variability : Variability, optional
        Variability of the photocentres, with a mission.
    excess_noise : float or (n,) array
        Along-scan error added to that of a point source in every transit, in quadrature, as
        of galaxies that are not points. [µas]
    quote_variability : bool
        Fold the variability into the errors of the field; the paper does not.
    sigma : float or array that broadcasts to (2, n), optional
        Standard errors, without a mission; Gaia's by magnitude unless given. [µas/yr]
    rho : float or (n,) array
        Correlation of the two components, without a mission.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose errors are taken where the mission does not say it.
    redshifts : {"true", "heliocentric", "cmb"}
        As they are; or as they are observed from the Sun or at rest in the microwave background, with what the
        signal's velocities do to them.
    redshift_error : float or (n,) array, or {"spectroscopic", "photometric"}
        Errors of the redshifts, which are drawn last: 1e-4, or 0.015 (1 + z) as of 2MPZ (Bilicki et al. 2014, ApJS
        210, 9), by name.
    threads : int, optional
        How many; one a core unless given.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Field
        With a mission, errors and correlations are those of the five-parameter solutions;
        sources that cannot be solved are left out and a note counts them.

    Raises
    ------
    ParameterError
        If errors are not above zero, or variability has no mission.
    FrameError
        If the sources are in another frame than the mission.

    Examples
    --------
    >>> from sim import acceleration, quasars
    >>> len(observe(quasars(100, rng=1), acceleration((5, 0, 0)), rng=2))
    100
    """
    rng = generator(rng)
    n = len(population)
    if attitude is not None:
        base_mission = as_mission(NominalScanningLaw() if mission is None else mission, release)
        mission = replace(base_mission, attitude=attitude)
    if mission is not None:
        if sigma is not None or np.any(rho != 0.0):
            raise ParameterError("a mission gives the errors and their correlation: sigma= and rho= are without one")
        errors, covariance, is_kept, notes = _solve_mission_sources(
            population, rng, as_mission(mission, release), variability, excess_noise, quote_variability, threads,
            progress, "motion",
        )  # fmt: skip
        population, (sigma, rho) = population[is_kept], split_covariance(covariance)
    else:
        if variability is not None or quote_variability or np.any(excess_noise != 0.0):
            raise ParameterError("variability and excess noise need a mission, at whose transits sources are displaced")
        if sigma is None:
            if population.magnitude is None:
                raise ParameterError("Gaia's errors need magnitudes: give sigma=, or a population that has them")
            sigma = gaia_errors(population.magnitude, release)
        sigma = arguments.float_array("sigma", sigma, (2, n), broadcast=True)
        rho = arguments.float_array("rho", rho, (n,), broadcast=True)
        if not ((sigma > 0).all() and (np.abs(rho) < 1).all()):
            raise ParameterError("sigma must be above zero, and rho between −1 and 1")
        draws = rng.standard_normal((2, n))
        errors, notes = sigma * np.stack([draws[0], rho * draws[0] + np.sqrt(1 - rho**2) * draws[1]]), []
    field = _make_observed_field(population, as_signal(signal), errors, notes, sigma, rho)
    return _observe_redshifts(field, as_signal(signal), redshifts, redshift_error, rng)


def _observe_redshifts(field, signal, frame, error, rng):
    """Replace the redshifts by observed ones; `field` has the true ones."""
    if field.redshift is None:
        if frame != "true" or np.any(error != 0.0):
            raise ParameterError("these sources have no redshifts that could be observed")
        return field
    redshift = signal.observed_redshift(field.lon, field.lat, field.redshift, frame)
    if isinstance(error, str):
        if error not in REDSHIFT_ERRORS:
            raise ParameterError(f"errors of redshifts are called {', '.join(REDSHIFT_ERRORS)}, not {error!r}")
        error_at_zero, slope = REDSHIFT_ERRORS[error]
        error = error_at_zero + slope * field.redshift
    error = arguments.float_array("redshift_error", error, (len(field),), broadcast=True)
    if (error < 0).any():
        raise ParameterError("redshift_error must be zero or more")
    redshift_error = None
    if error.any():
        redshift, redshift_error = redshift + error * rng.standard_normal(len(field)), error
    return replace(field, redshift=redshift, redshift_error=redshift_error, redshift_frame=frame)


def observe_offsets(
    population: Population,
    signal: Signal | Coefficients,
    rng: Rng,
    mission: Mission | NominalScanningLaw,
    *,
    radio: ArrayLike = 100.0,
    variability: Variability | None = None,
    release: Release = "DR3",
    threads: int | None = None,
    progress: bool = True,
) -> Field:
    """Draw the offsets of optical positions from noisy radio positions.

    Parameters
    ----------
    population : Population
        `vlbi_quasars(…)`
    signal : Signal or Coefficients
        The true offsets, `spin(ε)` for an orientation. [µas]
    rng : Generator or int
        The source of all randomness.
    mission : Mission or NominalScanningLaw
        As for `observe`.
    radio : float or (n,) array
        Standard error of a radio position in each component. [µas]
    variability : Variability, optional
        Variability of the photocentres.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose errors are taken where the mission does not say it.
    threads : int, optional
        How many; one a core unless given.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Field
        Offsets of positions [µas] at the middle of the mission.

    Examples
    --------
    >>> from sim import Mission, NominalScanningLaw, quasars, spin
    >>> field = observe_offsets(quasars(20, 1), spin((50, 0, 0)), 1, Mission(NominalScanningLaw(years=2.0)))
    >>> field.motion.shape[0]  # offsets of positions [µas]
    2
    """
    rng = generator(rng)
    errors, covariance, is_kept, notes = _solve_mission_sources(
        population, rng, as_mission(mission, release), variability, 0.0, False, threads, progress, "position"
    )
    radio_error = arguments.float_array("radio", radio, (len(population),), broadcast=True)[is_kept]
    errors = errors + radio_error * rng.standard_normal(errors.shape)
    covariance = covariance + radio_error[:, None, None] ** 2 * np.eye(2)
    return _make_observed_field(population[is_kept], as_signal(signal), errors, notes, *split_covariance(covariance))


def _solve_mission_sources(population, rng, mission, variability, excess_noise, quote, threads, progress, kind):
    """Errors (2, k) and covariances (k, 2, 2) of two of the five parameters; which sources have them."""
    mission.check_frame(population.frame)
    columns = COMPONENTS[kind]
    if mission.is_solved:
        return _solve_jointly(population, rng, mission, variability, excess_noise, quote, threads, progress, columns)
    # A seed of its own for every block: threads may take them in any order.
    block_rngs = rng.spawn(-(-len(population) // BLOCK) + 1)
    attitude_errors = mission.attitude_noise(block_rngs[-1])
    transit_error = mission.transit_error(population.magnitude, excess_noise)

    def solve_block(chunk, transits):
        block_rng = block_rngs[chunk.start // BLOCK]
        solution = solve_astrometry(
            transits,
            transit_error[chunk],
            block_rng,
            years=mission.years,
            variability=variability,
            attitude=attitude_errors,
            quote_variability=quote,
        )
        covariance = solution.covariance[:, columns, columns]
        return solution.errors[:, columns].T, covariance, solution.solved, len(transits)

    block_results = mission.scanning_law.map_transits(solve_block, population.lon, population.lat, threads, progress)
    all_errors, covariances, masks, counts = zip(*block_results, strict=True)
    errors, covariance, is_kept = np.concatenate(all_errors, axis=1), np.concatenate(covariances), np.concatenate(masks)
    notes = [f"simulated: {sum(counts)} transits in {mission.years:g} years, errors of {mission.release}"]
    if not is_kept.all():
        notes.append(f"left out {(~is_kept).sum()} of {len(is_kept)} sources: too few transits for five parameters")
    return errors[:, is_kept], covariance[is_kept], is_kept, notes


def _solve_jointly(population, rng, mission, variability, excess_noise, quote, threads, progress, columns):
    """Observe with an attitude that is solved as well, so that neighbours share errors."""
    if quote:
        raise ParameterError(
            "a joint solution quotes the errors of its measurements alone: quote_variability is for an attitude in µas"
        )
    transit_error = mission.transit_error(population.magnitude, excess_noise)
    solution, system, notes = solve_mission(
        mission.scanning_law,
        population.lon,
        population.lat,
        transit_error,
        rng,
        variability=variability,
        knots=mission.knots,
        threads=threads,
        progress=progress,
    )
    is_kept = solution.solved
    note = f"simulated: {len(system.scans)} transits in {mission.years:g} years, errors of {mission.release}"
    # What a field of the solution says of itself.
    notes = [note, *notes, *solution.field().notes]
    return solution.sources[is_kept][:, columns].T, solution.formal[is_kept][:, columns, columns], is_kept, notes


def _make_observed_field(population, signal, errors, notes, sigma, rho):
    motion = signal(population.lon, population.lat, population.redshift) + errors
    columns = {name: getattr(population, name) for name in ("redshift", "magnitude", "frame")}
    return Field(population.lon, population.lat, motion, sigma, rho, **columns, notes=notes)
