"""What Gaia's archive would hold of simulated sources, in its own columns.

A catalogue like Gaia-CRF3: five- and six-parameter solutions of quasars in the archive's columns, with a known truth.

Counts and medians are those of Gaia Collaboration, Klioner et al. (2022, A&A 667, A148, table 1): 1 215 942 sources
with five parameters (median G = 19.92, effective wavenumber 1.589 µm⁻¹, RUWE 1.013) and 398 231 with six (20.46,
1.044). What no table says is simple: the sky is that of quasars behind no Galactic plane, a six-parameter solution's
errors are 1.25 times those of five parameters at its magnitude, and one source in 500 has errors three times too small.
"""

from typing import Any

import numpy as np

from sim.astrometry import solve_astrometry
from sim.mission import Mission, as_mission
from sim.population import CRF3_COUNTS, SIX_PARAMETERS, Population, crf3_magnitudes, quasar_redshifts
from sim.scanning import NominalScanningLaw, sun_position
from sim.signal import Signal, acceleration, as_signal
from sim.skies import draw_positions
from vsh.coefficients import Coefficients
from vsh.io.epochs import design_row
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import centres, pixels_of
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ParameterError
from vsh.tools.types import BoolArray, FloatArray, Release, Rng, Table
from vsh.tools.units import MAS

#: Parallaxes of quasars in DR3, on average. [mas] (Lindegren et al. 2021, A&A 649, A4)
ZERO_POINT = -0.017
#: 34 months.
_YEARS = 34 / 12
_OUTLIERS, _TIMES = 0.002, 3.0
#: Shares of quasars whose best model in DR4 has seven and nine parameters: a guess.
_OTHER_MODELS = 0.003, 0.001
_NSIDE = 32
_CRF3_UNITS = {
    "ra": "deg", "dec": "deg", "parallax": "mas", "parallax_error": "mas", "pmra": "mas / yr", "pmdec": "mas / yr",
    "pmra_error": "mas / yr", "pmdec_error": "mas / yr", "nu_eff_used_in_astrometry": "1 / um",
    "pseudocolour": "1 / um", "phot_g_mean_mag": "mag", "bp_rp": "mag",
}  # fmt: skip


@arguments.accepts(n_five=arguments.whole, rng=arguments.seed)
def crf3(
    rng: Rng, signal: Signal | Coefficients | None = None, *, n_five: int = CRF3_COUNTS[31], n_six: int | None = None
) -> Table:
    """A catalogue like Gaia-CRF3.

    Parameters
    ----------
    rng : Generator or int
        The source of all randomness.
    signal : Signal or Coefficients, optional
        The true motions, ICRS; an acceleration of 4.3 µas/yr towards the Galactic centre unless given.
    n_five : int
        Sources with five-parameter solutions.
    n_six : int, optional
        With six; in CRF3's proportion unless given.

    Returns
    -------
    astropy Table
        In the columns and units of gaia_source and qso_candidates.

    Notes
    -----
    Errors and correlations are those of the scanning law over 34 months at the middle of each of 12 288 pixels, for the
    magnitude of each source; the noise of parallax and motion is drawn with their correlations.
    """
    return _frame_table(rng, signal, n_five, n_six, "DR3")


@arguments.accepts(n_five=arguments.whole, rng=arguments.seed)
def crf4(
    rng: Rng,
    signal: Signal | Coefficients | None = None,
    *,
    n_five: int = CRF3_COUNTS[31],
    n_six: int | None = None,
    table: str = "gaia_source",
) -> Table:
    """A catalogue like the quasars of Gaia DR4, for a rehearsal.

    Parameters
    ----------
    rng, signal, n_five, n_six
        As for `crf3`.
    table : {"gaia_source", "all_source_astrometry"}
        DR4's best model of each source, those of stars that are not single among them, by which one quasar in 250 is
        lost (a guess: nobody knows how many); or the core solution of all.

    Returns
    -------
    astropy Table
        In the columns of DR4's draft data model: astrometric_params and tentative_parallax_bias.

    Notes
    -----
    As `crf3`, over the 66 months of DR4 and with the errors that are expected of it; epoch J2017.5.
    """
    arguments.choice("table", table, ("gaia_source", "all_source_astrometry"))
    rng = generator(rng)
    made = _frame_table(rng, signal, n_five, n_six, "DR4")
    params = np.asarray(made["astrometric_params_solved"]).copy()
    if table == "gaia_source":
        draw = rng.spawn(1)[0].random(len(made))
        params[draw < _OTHER_MODELS[0]] = 127  # seven parameters: an acceleration
        params[(draw >= _OTHER_MODELS[0]) & (draw < sum(_OTHER_MODELS))] = 511  # nine: its change as well
    made["astrometric_params_solved"] = params
    made.rename_column("astrometric_params_solved", "astrometric_params")
    made["tentative_parallax_bias"] = np.full(len(made), ZERO_POINT, np.float32)
    made["tentative_parallax_bias"].unit = "mas"
    made.meta |= {"REFEPOCH": 2017.5, "RELEASE": "simulated quasars of Gaia DR4", "TABLE": table}
    return made


def _frame_table(rng, signal, n_five, n_six, release):
    """The table of `crf3`, or of another release."""
    years = {"DR3": _YEARS, "DR4": 66 / 12}[release]
    wanted = n_five * CRF3_COUNTS[95] / CRF3_COUNTS[31] if n_six is None else arguments.not_negative("n_six", n_six)
    n = n_five + round(wanted)
    truth = acceleration((-0.235965, -3.755779, -2.080491)) if signal is None else as_signal(signal)
    # A stream of its own for each step, so that one number does not shift what another draws.
    sky, light, errors, noise, rest, gaps = generator(rng).spawn(6)
    lon, lat = draw_positions(n, sky, "gums")
    six = np.arange(n) >= n_five
    magnitude = crf3_magnitudes(n_five, n - n_five, light)
    mission = Mission(NominalScanningLaw(years=years, rng=gaps), release)
    pixel = pixels_of(lon, lat, _NSIDE)
    there = solve_astrometry(mission.scanning_law.transits(*centres(_NSIDE)), np.ones(12 * _NSIDE**2), 0, years=years)
    unit = there.covariance[:, 2:, 2:]  # parallax, µ_α*, µ_δ for a transit's error of one
    unit = np.where(np.isfinite(unit), unit, np.nanmedian(unit, axis=0))
    # A little of its own for each source: transits are lost.
    size = mission.transit_error(magnitude) * np.where(six, SIX_PARAMETERS, 1.0) * errors.lognormal(0.0, 0.05, n)
    deviation = np.sqrt(np.einsum("nii->ni", unit))
    correlation = unit / (deviation[:, :, None] * deviation[:, None])
    wrong = np.where(errors.random(n) < _OUTLIERS, _TIMES, 1.0)
    drawn = np.einsum("nij,nj->in", np.linalg.cholesky(unit)[pixel], noise.standard_normal((n, 3))) * size * wrong
    sigma = deviation[pixel].T * size
    motion = (truth(lon, lat) + drawn[1:]) / MAS
    columns = {
        "source_id": _identifiers(lon, lat),
        "ra": np.degrees(lon),
        "dec": np.degrees(lat),
        "parallax": ZERO_POINT + drawn[0] / MAS,
        "parallax_error": sigma[0] / MAS,
        "pmra": motion[0],
        "pmdec": motion[1],
        "pmra_error": sigma[1] / MAS,
        "pmdec_error": sigma[2] / MAS,
        "parallax_pmra_corr": correlation[pixel, 0, 1],
        "parallax_pmdec_corr": correlation[pixel, 0, 2],
        "pmra_pmdec_corr": correlation[pixel, 1, 2],
        "astrometric_params_solved": np.where(six, 95, 31).astype(np.int16),
    }
    return _table(columns | _light(rest, six, magnitude))


def _light(rng: np.random.Generator, six: BoolArray, magnitude: FloatArray) -> dict[str, Any]:
    """Colours, redshifts and quality."""
    n = len(six)
    wavenumber = rng.normal(1.589, 0.06, n)
    z = np.where(rng.random(n) < 0.6, quasar_redshifts(n, rng), np.nan)
    return {
        "nu_eff_used_in_astrometry": np.where(six, np.nan, wavenumber).astype(np.float32),
        "pseudocolour": np.where(six, wavenumber, np.nan).astype(np.float32),
        "ruwe": np.where(six, 1.044, 1.013) * rng.lognormal(0.0, 0.04, n).astype(np.float32),
        "phot_g_mean_mag": magnitude.astype(np.float32),
        "bp_rp": ((1.73 - wavenumber) / 0.2 + rng.normal(0, 0.1, n)).astype(np.float32),
        "redshift_qsoc": z.astype(np.float32),
        "used_for_reference_frame_spin": ~six & (rng.random(n) < 0.353),
    }


def _identifiers(lon, lat):
    """Numbers as Gaia makes them: the HEALPix pixel of level 12, nested, then a running number."""
    pixel = pixels_of(lon, lat, 4096, nested=True)
    order = np.argsort(pixel, kind="stable")
    first = np.searchsorted(pixel[order], pixel[order])
    running = np.empty(len(pixel), np.int64)
    running[order] = np.arange(len(pixel)) - first
    return pixel.astype(np.int64) * 2**35 + (running + 1) * 2**7


def _table(columns):
    from vsh.io import tables

    return tables.table_of(columns, {"REFEPOCH": 2016.0, "RELEASE": "simulated Gaia-CRF3"}, _CRF3_UNITS)


#: CCDs of the astrometric field along a row, and the time from one to the next. [ns]
CCDS, _STEP = 9, 4.85e9
_YEAR = 365.25 * 86400e9  # [ns]
#: Light takes so long for an astronomical unit. [ns]
_AU = 499.004784e9
#: Epoch of the positions. [Julian year, TCB]
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
        Release whose errors are taken where the mission does not say it.
    outliers : float
        The share of observations whose noise is ten times as large.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    astropy Table
        source_id (from 1), transit_id, obs_time_tcb [ns since J2010.0 at Gaia], obs_time_bary_corr [ns],
        centroid_pos_al and its error [mas], scan_pos_angle [deg], parallax_factor_al, used_by_agis_al, ra0, dec0,
        agis_source_excess_noise.

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

    from vsh.io import tables

    columns = {
        "source_id": source.astype(np.int64) + 1,
        "transit_id": np.arange(len(source), dtype=np.int64),
        "obs_time_tcb": (at_sun - early).astype(np.int64),
        "obs_time_bary_corr": early[:, 0].astype(np.int64),
        "centroid_pos_al": centroid / MAS,
        "centroid_pos_error_al": sigma / MAS,
        "scan_pos_angle": np.degrees(transits.angle),
        "parallax_factor_al": transits.parallax_factor,
        "used_by_agis_al": np.ones(shape, bool),
        "ra0": np.degrees(population.lon[source]),
        "dec0": np.degrees(population.lat[source]),
        "agis_source_excess_noise": np.zeros(len(source)),
    }
    return tables.table_of(columns, {"REFEPOCH": EPOCH, "RELEASE": "simulated DR4 epoch astrometry"}, _EPOCH_UNITS)


def _roemer(law, time, lon, lat):
    """By how much a signal is seen earlier at Gaia than at the Sun. [ns]"""
    longitude, distance = sun_position(law.start, time)
    toward_sun = rotation_matrix("ecliptic", "icrs") @ triad(longitude, np.zeros_like(longitude))[2]
    # Gaia stands 1 % beyond the Earth, away from the Sun.
    return -1.01 * distance * np.einsum("ik,ik->k", toward_sun, triad(lon, lat)[2]) * _AU
