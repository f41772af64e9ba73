"""Transits of simulated sources in the columns of DR4's epoch astrometry (the draft of its data model)."""

from __future__ import annotations

import numpy as np

from sim.mission import Mission, as_mission
from sim.population import Population
from sim.scanning import NominalScanningLaw, sun_position
from sim.signal import Signal, as_signal
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import Release, Rng, Table
from vsh.coefficients import Coefficients
from vsh.epochs import design_row
from vsh.errors import ParameterError
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.units import MAS

#: CCDs of the astrometric field along a row, and the time from one to the next. [ns]
CCDS, _STEP = 9, 4.85e9
_YEAR = 365.25 * 86400e9  # [ns]
#: Light takes so long for an astronomical unit. [ns]
_AU = 499.004784e9
#: Of positions. [Julian year, TCB]
EPOCH = 2017.5
_EPOCH_UNITS = {
    "obs_time_tcb": "ns", "obs_time_bary_corr": "ns", "centroid_pos_al": "mas", "centroid_pos_error_al": "mas",
    "scan_pos_angle": "deg", "ra0": "deg", "dec0": "deg", "agis_source_excess_noise": "mas",
}  # fmt: skip


@arguments.accepts(population=arguments.a(Population), rng=arguments.seed)
def epochs(
    population: Population,
    signal: Signal | Coefficients,
    rng: Rng,
    *,
    mission: Mission | NominalScanningLaw | None = None,
    release: Release = "DR4",
    outliers: float = 0.0,
    threads: int | None = None,
) -> Table:
    """Every transit of a population as DR4 will publish it: a row a transit, arrays of its nine CCDs.

    Parameters
    ----------
    population : Population
        In ICRS, with magnitudes.
    signal : Signal or Coefficients
        The true motions. [µas/yr]
    rng : Generator or int
        The source of all randomness.
    mission : Mission or NominalScanningLaw, optional
        66 months of the nominal scanning law unless given.
    release : {"DR3", "DR4", "DR5", "paper"}
        Whose errors, where the mission does not say it.
    outliers : float
        The share of observations whose noise is ten times as large.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    astropy Table
        source_id (from 1), transit_id, obs_time_tcb [ns since J2010.0 at Gaia], obs_time_bary_corr [ns], centroid_pos_al
        and its error [mas], scan_pos_angle [deg], parallax_factor_al, used_by_agis_al, ra0, dec0, agis_source_excess_noise.

    Raises
    ------
    FrameError
        If the sources are in another frame than the mission.
    ParameterError
        If the share of outliers is not between 0 and 1, or there are no magnitudes.

    Notes
    -----
    A transit's error is that of `sim.observe`; a CCD's is three times as large. Positions of quasars at EPOCH, without
    parallax; the attitude is perfect.
    """
    noise, gaps = generator(rng).spawn(2)
    mission = as_mission(NominalScanningLaw(years=5.5, rng=gaps) if mission is None else mission, release)
    mission.check_frame(population.frame)
    share = arguments.not_negative("outliers", outliers)
    if share > 1:
        raise ParameterError(f"the share of outliers lies between 0 and 1, not at {outliers!r}")
    error = mission.transit_error(population.magnitude)
    transits = mission.scanning_law.transits(population.lon, population.lat, threads=threads)
    motion = as_signal(signal)(population.lon, population.lat, population.redshift)
    source, since = transits.source, mission.scanning_law.start + transits.time - EPOCH
    row = design_row(transits.angle, transits.parallax_factor, since)
    place = motion[0, source] * row[3] + motion[1, source] * row[4]
    shape = (len(source), CCDS)
    sigma = np.repeat(3 * error[source][:, None], CCDS, axis=1)
    wrong = np.where(noise.random(shape) < share, 10.0, 1.0)
    centroid = place[:, None] + sigma * wrong * noise.standard_normal(shape)
    roemer = _roemer(mission.scanning_law, transits.time, population.lon[source], population.lat[source])
    steps = (np.arange(CCDS) - (CCDS - 1) / 2) * _STEP
    at_sun = np.round((EPOCH - 2010.0 + since)[:, None] * _YEAR + steps)
    early = np.round(roemer)[:, None]

    from vsh import tables

    columns = {
        "source_id": source.astype(np.int64) + 1, "transit_id": np.arange(len(source), dtype=np.int64),
        "obs_time_tcb": (at_sun - early).astype(np.int64), "obs_time_bary_corr": early[:, 0].astype(np.int64),
        "centroid_pos_al": centroid / MAS, "centroid_pos_error_al": sigma / MAS,
        "scan_pos_angle": np.degrees(transits.angle), "parallax_factor_al": transits.parallax_factor,
        "used_by_agis_al": np.ones(shape, bool), "ra0": np.degrees(population.lon[source]),
        "dec0": np.degrees(population.lat[source]), "agis_source_excess_noise": np.zeros(len(source)),
    }  # fmt: skip
    return tables.table_of(columns, {"REFEPOCH": EPOCH, "RELEASE": "simulated DR4 epoch astrometry"}, _EPOCH_UNITS)


def _roemer(law, time, lon, lat):
    """By how much a signal is seen earlier at Gaia than at the Sun. [ns]"""
    longitude, distance = sun_position(law.start, time)
    toward_sun = rotation_matrix("ecliptic", "icrs") @ triad(longitude, np.zeros_like(longitude))[2]
    # Gaia stands 1 % beyond the Earth, away from the Sun.
    return -1.01 * distance * np.einsum("ik,ik->k", toward_sun, triad(lon, lat)[2]) * _AU
