"""What a mission would do to sources, without drawing it: formal and true covariances of their solutions."""

from typing import Literal

import numpy as np

from sim.astrometry import COMPONENTS, predict_solution_covariances, solve_astrometry, split_covariance
from sim.mission import Mission, as_mission
from sim.population import Population
from sim.scanning import NominalScanningLaw
from sim.variability import Variability
from vsh.sky.pixels import centres, check_nside, pixels_of
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, Release

__all__ = ["errors_by_place", "scan_maps"]


def expected_covariances(
    population: Population,
    mission: Mission | NominalScanningLaw,
    kind: Literal["motion", "position"] = "motion",
    *,
    variability: Variability | None = None,
    excess_noise: ArrayLike = 0.0,
    release: Release = "DR3",
    threads: int | None = None,
    progress: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Compute the formal and true 2 × 2 covariances of five-parameter solutions over a mission.

    Parameters
    ----------
    population : Population
        The sources, in the frame of the mission.
    mission : Mission or NominalScanningLaw
        As for `sim.observe`; the errors of the attitude are assumed to be independent from transit to transit.
    kind : {"motion", "position"}
        Which two of the five parameters the covariances are of.
    variability : Variability, optional
        Variability of the photocentres.
    excess_noise : float or (n,) array
        Along-scan error added in quadrature to every transit. [µas]
    release : {"DR3", "DR4", "DR5", "paper"}
        Data release whose errors are used if the mission does not specify one.
    threads : int, optional
        How many; one per core unless given.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    formal, true : (n, 2, 2) arrays
        Covariances as a catalogue would quote them, and as the errors actually scatter, with variability
        and attitude included. nan for sources with too few transits. [µas² or (µas/yr)²]

    Raises
    ------
    ParameterError
        If the kind is unknown, or the attitude is solved with the sources.
    FrameError
        If the sources are in another frame than the mission.

    Examples
    --------
    >>> from sim import Mission, NominalScanningLaw, quasars
    >>> formal, true = expected_covariances(quasars(4, 1), Mission(NominalScanningLaw(years=2.0)))
    >>> formal.shape, bool((true[:, 0, 0] >= formal[:, 0, 0]).all())
    ((4, 2, 2), True)
    """
    columns = COMPONENTS[arguments.choice("kind", kind, tuple(COMPONENTS))]
    mission = as_mission(mission, release)
    mission.check_frame(population.frame)
    if isinstance(mission.attitude, str):
        raise ParameterError(
            "if the attitude is solved with the sources, the errors of different sources are correlated: use "
            "sim.agis.System"
        )
    if not len(population):
        return np.zeros((0, 2, 2)), np.zeros((0, 2, 2))
    error = mission.transit_error(population.magnitude, excess_noise)

    def compute_block(chunk, transits):
        return predict_solution_covariances(
            transits, error[chunk], years=mission.years, variability=variability, attitude=float(mission.attitude)
        )

    covariances = mission.scanning_law.map_transits(compute_block, population.lon, population.lat, threads, progress)
    formal, true = (np.concatenate(blocks)[:, columns, columns] for blocks in zip(*covariances, strict=True))
    return formal, true


def errors_by_place(
    magnitude: ArrayLike,
    lon: ArrayLike,
    lat: ArrayLike,
    mission: Mission | NominalScanningLaw,
    *,
    release: Release = "DR3",
    nside: int = 16,
) -> tuple[FloatArray, FloatArray]:
    """Standard errors and correlation of µ_α* and µ_δ by magnitude and position, without simulating each transit.

    The scanning law is evaluated at the centre of every HEALPix pixel; each source gets the errors of its pixel, scaled
    with its magnitude. The errors are formal ones: those of the mission's attitude are not included.

    Parameters
    ----------
    magnitude, lon, lat : (n,) arrays
        G magnitudes, and positions in the mission's frame. [rad]
    mission : Mission or NominalScanningLaw
        As for `sim.observe`.
    release : {"DR3", "DR4", "DR5", "paper"}
        The data release that sets the sky-mean parallax error if the mission does not specify one.
    nside : int
        Resolution of the HEALPix pixels.

    Returns
    -------
    sigma : (2, n) array
        [µas/yr]
    rho : (n,) array
        Correlation of the two errors.

    Raises
    ------
    ParameterError
        If a source has too few transits for five parameters.
    """
    mission = as_mission(mission, release)
    pixels, pixel_index = np.unique(pixels_of(lon, lat, nside), return_inverse=True)
    places = [angle[pixels] for angle in centres(nside)]
    solution = solve_astrometry(mission.scanning_law.transits(*places), np.ones(len(pixels)), 0, years=mission.years)
    covariance = solution.covariance[pixel_index][:, 3:, 3:]
    is_lost = ~np.isfinite(covariance).all((1, 2))
    if is_lost.any():
        raise ParameterError(
            f"{is_lost.sum()} of {is_lost.size} sources have too few transits for five parameters in {mission.years:g} "
            "years: a longer mission (years=) gives all of them errors"
        )
    unit_errors, rho = split_covariance(covariance)
    return mission.transit_error(magnitude) * unit_errors, rho


def scan_maps(
    law: Mission | NominalScanningLaw, nside: int = 8, *, threads: int | None = None
) -> dict[str, FloatArray]:
    """Maps of how a mission scans the sky: templates of what its scanning may cause (`fit.background.Template`).

    Parameters
    ----------
    law : Mission or NominalScanningLaw
        The mission.
    nside : int
        Resolution of the maps.
    threads : int, optional
        How many; one per core unless given.

    Returns
    -------
    dict of (12 nside²,) arrays
        HEALPix maps in ring order and the mission's frame: "transits", their number, and "cos kψ", "sin kψ" for k = 1 …
        4, the means over the transits of the angle ψ of the scans, as the moments `scan_direction` of Gaia's archive.

    Examples
    --------
    >>> maps = scan_maps(NominalScanningLaw(years=0.5), nside=1)
    >>> sorted(maps)[:3], maps["transits"].shape
    (['cos 1ψ', 'cos 2ψ', 'cos 3ψ'], (12,))
    """
    scanning = as_mission(law).scanning_law
    lon, lat = centres(check_nside(nside))
    transits = scanning.transits(lon, lat, threads=threads)
    counts = transits.counts(lon.size).astype(float)
    maps = {"transits": counts}
    for k in range(1, 5):
        for name, function in (("cos", np.cos), ("sin", np.sin)):
            total = np.bincount(transits.source, function(k * transits.angle), lon.size)
            maps[f"{name} {k}ψ"] = np.divide(total, counts, out=np.full(lon.size, np.nan), where=counts > 0)
    return maps
