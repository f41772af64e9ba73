"""Every transit of simulated sources, in the columns of DR4's epoch astrometry."""

from typing import Any

import numpy as np

from sim.mission import Mission, as_mission
from sim.population import Population, uniform_sky
from sim.scanning import NominalScanningLaw, Transits, sun_position
from sim.signal import Signal, as_signal
from vsh.coefficients import Coefficients
from vsh.io.epochs import make_design_rows
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, Release, Rng, Table
from vsh.tools.units import MAS

#: CCDs of the astrometric field along a row, and the time from one to the next. [ns]
CCDS, _CCD_STEP = 9, 4.85e9
_YEAR_NS = 365.25 * 86400e9  # [ns]
#: Light takes so long for an astronomical unit. [ns]
_AU_NS = 499.004784e9
#: Epoch of the positions. [Julian year, TCB]
EPOCH = 2017.5
_EPOCH_UNITS = {
    "obs_time_tcb": "ns", "obs_time_bary_corr": "ns", "centroid_pos_al": "mas", "centroid_pos_error_al": "mas",
    "scan_pos_angle": "deg", "ra0": "deg", "dec0": "deg", "agis_source_excess_noise": "mas", "zeta": "deg",
    "nu_eff_used_in_astrometry": "1 / um", "nu_eff_error": "1 / um", "g_mag": "mag", "ac_rate": "pix / s",
    "calculated_pos_ac": "mas", "ipd_error_al": "mas", "ipd_error_ac": "mas", "centroid_pos_ac": "mas",
    "centroid_pos_error_ac": "mas", "source_dist_to_last_ci": "pix", "sub_pixel_coord": "pix", "mu": "pix",
}  # fmt: skip
#: What stands where nothing was measured: the error of a centroid in RC3 of the pre-release. [mas]
SENTINEL = 2.0628e8
#: Knots of the attitude that stars and quasars are solved with [s], error of a transit of a star [µas], iterations.
_KNOT_STEP, _STAR_ERROR, _ITERATIONS = 900.0, 100.0, 60


@arguments.accepts(population=arguments.a(Population), rng=arguments.seed, stars=arguments.whole)
def epochs(
    population: Population,
    signal: Signal | Coefficients,
    rng: Rng,
    *,
    mission: Mission | NominalScanningLaw | None = None,
    release: Release = "DR4",
    outliers: float = 0.0,
    excess_noise: ArrayLike = 0.0,
    attitude: str = "perfect",
    stars: int = 20_000,
    calibration: str | None = "constant to order 8",
    complete: bool = False,
    threads: int | None = None,
) -> Table:
    """Simulate the transits of a population as DR4 will publish them: one row per transit, arrays of its CCDs.

    Parameters
    ----------
    population : Population
        In ICRS, with magnitudes.
    signal : Signal or Coefficients
        The true motions [µas/yr], and what changes within the mission (`wave_in_time`, `in_time`).
    rng : Generator or int
        The source of all randomness.
    mission : Mission or NominalScanningLaw, optional
        66 months of the nominal scanning law unless given.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose errors are taken where the mission does not say it.
    outliers : float
        The share of observations whose noise is ten times as large.
    excess_noise : float or (n,) array
        Scatter of every CCD's observation beyond its error, as of a source with structure: what AGIS finds stands in
        agis_source_excess_noise, and not in the errors of centroids. [µas]
    attitude : {"perfect", "solved"}
        Whether the attitude is known, or solved together with the sources from what they all show, as AGIS does: it
        then takes a part of what changes (`sim.agis.Response`).
    stars : int
        How many stars of 100 µas a transit, anywhere on the sky, hold an attitude that is solved, with knots of 900 s.
    calibration : str or None
        What is calibrated of the basic angle where the attitude is solved, as "free every 5 days to order 1"; "none"
        for nothing.
    complete : bool
        All 37 columns of the pre-release of DR4, ten CCDs a transit with the sky mapper's first, which is never used,
        and sentinels where nothing was measured.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    astropy Table
        source_id (from 1), transit_id (bits 15 and 16 the field of view: 0 preceding, 1 following; bits 12 to 14 the
        row of CCDs, 1 to 7), obs_time_tcb [ns since J2010.0 at Gaia], obs_time_bary_corr [ns], centroid_pos_al and its
        error [mas], scan_pos_angle [deg], parallax_factor_al, used_by_agis_al, ra0, dec0, agis_source_excess_noise.

    Raises
    ------
    FrameError
        If the sources are in another frame than the mission.
    ParameterError
        If the share of outliers is not between 0 and 1, an excess noise is below zero, there are no magnitudes, the
        attitude is another, or the calibration has another form.

    Notes
    -----
    A transit's error is that of `sim.observe`; a CCD's is three times as large. Positions of quasars at EPOCH, without
    parallax. What the columns of a complete table hold that no reader here uses is of the right type and size only.

    Examples
    --------
    >>> from sim import Mission, NominalScanningLaw, quasars, spin
    >>> mission = Mission(NominalScanningLaw(years=1.0))
    >>> table = epochs(quasars(5, 1), spin((0, 0, 0)), 1, mission=mission)
    >>> len(table) > 20
    True
    """
    noise_rng, gap_rng, auxiliary_rng = generator(rng).spawn(3)
    mission = as_mission(NominalScanningLaw(years=5.5, rng=gap_rng) if mission is None else mission, release)
    mission.check_frame(population.frame)
    outlier_share = arguments.not_negative("outliers", outliers)
    if outlier_share > 1:
        raise ParameterError(f"the share of outliers lies between 0 and 1, not at {outliers!r}")
    arguments.choice("attitude", attitude, ("perfect", "solved"))
    truth, law = as_signal(signal), mission.scanning_law
    error = mission.transit_error(population.magnitude)
    transits = law.transits(population.lon, population.lat, threads=threads)
    steady = truth.steady
    motion = steady(population.lon, population.lat, population.redshift) if steady.parts else np.zeros((2, len(error)))
    source, since = transits.source, law.start + transits.time - EPOCH
    design = make_design_rows(transits.angle, transits.parallax_factor, since)
    position = motion[0, source] * design[3] + motion[1, source] * design[4]
    if truth.changes:
        displacement = truth.displacement(population.lon[source], population.lat[source], since)
        position += np.sum(displacement * design[:2], 0)
    shape = (len(source), CCDS)
    sigma = np.repeat(3 * error[source][:, None], CCDS, axis=1)
    outlier_factor = np.where(noise_rng.random(shape) < outlier_share, 10.0, 1.0)
    excess = arguments.float_array("excess_noise", excess_noise, error.shape, broadcast=True)
    if not (excess >= 0).all():
        raise ParameterError(f"{np.sum(~(excess >= 0))} excess noises are below zero")
    scatter = np.hypot(sigma * outlier_factor, excess[source][:, None]) * noise_rng.standard_normal(shape)
    if attitude == "solved":
        position -= _compute_absorbed_part(
            law, population, truth, transits, error, scatter.mean(1), stars, calibration, auxiliary_rng, threads
        )
    centroid = position[:, None] + scatter
    roemer_delay = _compute_roemer_delays(law, transits.time, population.lon[source], population.lat[source])
    ccd_offsets = (np.arange(CCDS) - (CCDS - 1) / 2) * _CCD_STEP
    sun_time = np.round((EPOCH - 2010.0 + since)[:, None] * _YEAR_NS + ccd_offsets)
    bary_correction = np.round(roemer_delay)[:, None]

    from vsh.io import tables

    columns = {
        "source_id": source.astype(np.int64) + 1,
        "transit_id": _make_transit_ids(transits, sun_time[:, 0], law.half_height),
        "obs_time_tcb": (sun_time - bary_correction).astype(np.int64),
        "obs_time_bary_corr": bary_correction[:, 0].astype(np.int64),
        "centroid_pos_al": centroid / MAS,
        "centroid_pos_error_al": sigma / MAS,
        "scan_pos_angle": np.degrees(transits.angle),
        "parallax_factor_al": transits.parallax_factor,
        "used_by_agis_al": np.ones(shape, bool),
        "ra0": np.degrees(population.lon[source]),
        "dec0": np.degrees(population.lat[source]),
        "agis_source_excess_noise": excess[source] / MAS,
    }
    if complete:
        columns = _make_all_columns(columns, transits, np.asarray(population.magnitude, float)[source], auxiliary_rng)
    units = {name: unit for name, unit in _EPOCH_UNITS.items() if name in columns}
    return tables.table_of(columns, {"REFEPOCH": EPOCH, "RELEASE": "simulated DR4 epoch astrometry"}, units)


def _make_transit_ids(transits, time, half_height):
    """transit_id as ESA's epochs of Gaia BH3 have it: rising with time, then the field of view and the row of CCDs."""
    view = np.where(transits.view > 0, 0, 1).astype(np.int64)
    row = np.clip(np.floor(3.5 * (transits.across / half_height + 1)), 0, 6).astype(np.int64) + 1
    tick = (np.asarray(time) / 51_200).astype(np.int64)  # 2¹⁵ × 1.5625 ns
    return (tick >> 2 << 17) | (view << 15) | (row << 12) | (np.arange(len(time), dtype=np.int64) % 2**12)


def _compute_absorbed_part(law, population, truth, transits, error, scatter, n_stars, calibration, rng, threads):
    """Part of each transit that an attitude and a basic angle solved together with all sources take. [µas]"""
    from sim.agis import System, observations, scans  # numba and sparse matrices, for this alone

    position_rng, noise_rng = rng.spawn(2)
    lon, lat = uniform_sky(n_stars, position_rng)
    n_sources = len(error)
    sigma = np.r_[error, np.full(n_stars, _STAR_ERROR)]
    mission_scans = scans(
        law, np.r_[population.lon, lon], np.r_[population.lat, lat], sigma, 5 * sigma, knots=_KNOT_STEP, threads=threads
    )
    system, time = System(mission_scans, threads=threads, calibration=calibration), mission_scans.time()
    rows = np.flatnonzero(mission_scans.source < n_sources)
    rows = rows[np.lexsort([time[rows], mission_scans.source[rows]])]  # in the order of the transits
    if not np.array_equal(mission_scans.source[rows], transits.source):
        raise ParameterError("transits at the edges of the mission differ: take another mission")
    along, across = observations(mission_scans, noise_rng)
    along[rows] = scatter
    if truth.changes:
        sin, cos = mission_scans.sin.astype(float), mission_scans.cos.astype(float)
        east, north = truth.displacement(
            mission_scans.lon[mission_scans.source], mission_scans.lat[mission_scans.source], law.start + time - EPOCH
        )
        along += east * sin + north * cos
        across += north * sin - east * cos
    solution = system.solve(along, across, stop=None, iterations=_ITERATIONS)
    prediction, _ = system.predict(np.zeros((len(sigma), 5)), solution.attitude, solution.angle)
    return prediction[rows]


def _make_all_columns(columns: dict[str, Any], transits: Transits, magnitude: FloatArray, rng: np.random.Generator):
    """All columns of the pre-release: ten CCDs, of which the first is the sky mapper's."""
    k = len(magnitude)

    def add_sky_mapper(ccd_values, mapper_value, dtype):
        ccd_values = np.broadcast_to(np.reshape(ccd_values, (k, -1)), (k, CCDS))
        return np.concatenate([np.full((k, 1), mapper_value), ccd_values], 1).astype(dtype)

    error = np.asarray(columns["centroid_pos_error_al"])
    is_lost = rng.random((k, CCDS)) < 0.002  # nothing was measured
    times = np.asarray(columns["obs_time_tcb"])
    times_with_mapper = np.concatenate([times[:, :1] - int(7.26e9), times], 1)
    centroid, sigma = np.where(is_lost, np.nan, columns["centroid_pos_al"]), np.where(is_lost, SENTINEL, error)
    zeros, zero_flags = np.zeros((k, 1)), np.zeros(k, np.int16)
    return {
        "solution_id": np.full(k, 2888461026632663040, np.int64),
        **{name: columns[name] for name in ("source_id", "transit_id", "ra0", "dec0")},
        "agis_source_excess_noise": np.asarray(columns["agis_source_excess_noise"], np.float32),
        "obs_time_bary_corr": np.asarray(columns["obs_time_bary_corr"], np.float32),
        "zeta": np.degrees(transits.across).astype(np.float32),
        "parallax_factor_al": np.asarray(columns["parallax_factor_al"], np.float32),
        "parallax_factor_ac": np.full(k, np.sqrt(0.5), np.float32),
        "nu_eff_used_in_astrometry": np.full(k, 1.589, np.float32),
        "nu_eff_error": np.full(k, 0.01, np.float32),
        "transit_acq_flags": zero_flags,
        "transit_proc_flags": zero_flags,
        "multipeak": np.zeros(k, bool),
        "blended": np.zeros(k, bool),
        "g_mag": magnitude.astype(np.float32),
        "g_class": np.where(magnitude < 13, 0, np.where(magnitude < 16, 1, 2)).astype(np.int16),
        "ac_rate": rng.normal(0, 0.5, k).astype(np.float32),
        "obs_time_tcb": times_with_mapper,
        "scan_pos_angle": add_sky_mapper(columns["scan_pos_angle"], np.nan, float),
        "colour_factor_al": add_sky_mapper(zeros, 0.0, np.float32),
        "colour_factor_ac": add_sky_mapper(zeros, np.nan, np.float32),
        "centroid_pos_al": add_sky_mapper(centroid, 46_009.93, float),
        "centroid_pos_ac": np.full((k, 10), np.nan),
        "calculated_pos_ac": add_sky_mapper(zeros, np.nan, float),
        "centroid_pos_error_al": add_sky_mapper(sigma, 0.3024, np.float32),
        "centroid_pos_error_ac": np.full((k, 10), np.nan, np.float32),
        "used_by_agis_al": add_sky_mapper(~is_lost, False, bool),
        "used_by_agis_ac": np.zeros((k, 10), bool),
        "ccd_proc_flags": np.zeros((k, 10), np.int16),
        "ipd_error_al": add_sky_mapper(error, np.nan, np.float32),
        "ipd_error_ac": np.full((k, 10), np.nan, np.float32),
        "gates": add_sky_mapper(zeros, 12, np.int16),
        "source_dist_to_last_ci": add_sky_mapper(rng.uniform(0, 2000, (k, CCDS)), np.nan, np.float32),
        "sub_pixel_coord": add_sky_mapper(rng.random((k, CCDS)), 0.0, np.float32),
        "mu": add_sky_mapper(rng.uniform(13, 1991, (k, CCDS)), 1000.0, np.float32),
    }


def _compute_roemer_delays(law, time, lon, lat):
    """Time by which a signal is seen earlier at Gaia than at the Sun. [ns]"""
    sun_longitude, distance = sun_position(law.start, time)
    toward_sun = rotation_matrix("ecliptic", "icrs") @ triad(sun_longitude, np.zeros_like(sun_longitude))[2]
    # Gaia stands 1 % beyond the Earth, away from the Sun.
    return -1.01 * distance * np.einsum("ik,ik->k", toward_sun, triad(lon, lat)[2]) * _AU_NS
