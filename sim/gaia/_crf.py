"""A catalogue like Gaia-CRF3: five- and six-parameter solutions of quasars, with a known truth.

Counts and medians are those of Gaia Collaboration, Klioner et al. (2022, A&A 667, A148, table 1): 1 215 942 sources
with five parameters (median G = 19.92, effective wavenumber 1.589 µm⁻¹, RUWE 1.013) and 398 231 with six (20.46,
1.044). What no table says is simple: the sky is that of quasars behind no Galactic plane, a six-parameter solution's
errors are 1.25 times those of five parameters at its magnitude, and one source in 500 has errors three times too small.
"""

from typing import Any

import numpy as np

from sim.astrometry import solve_astrometry
from sim.gaia._link import draw_systematics, find_error_inflation, find_wavenumber_offset, learn_redshifts, scan_columns
from sim.mission import Mission
from sim.population import CRF3_COUNTS, SIX_PARAMETERS, assign_redshifts, draw_crf3_magnitudes, quasar_redshifts
from sim.scanning import NominalScanningLaw
from sim.signal import Signal, acceleration, as_signal
from sim.skies import draw_positions
from vsh.coefficients import Coefficients
from vsh.sky.pixels import centres, pixels_of
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.types import BoolArray, FloatArray, Rng, Table
from vsh.tools.units import MAS

#: Parallaxes of quasars in DR3, on average. [mas] (Lindegren et al. 2021, A&A 649, A4)
ZERO_POINT = -0.017
#: 34 months.
_DR3_YEARS = 34 / 12
_OUTLIER_SHARE, _OUTLIER_FACTOR = 0.002, 3.0
#: Shares of quasars whose best model in DR4 has seven and nine parameters: a guess.
_OTHER_MODEL_SHARES = 0.003, 0.001
_NSIDE = 32
_CRF3_UNITS = {
    "ra": "deg", "dec": "deg", "parallax": "mas", "parallax_error": "mas", "pmra": "mas / yr", "pmdec": "mas / yr",
    "pmra_error": "mas / yr", "pmdec_error": "mas / yr", "nu_eff_used_in_astrometry": "1 / um",
    "pseudocolour": "1 / um", "phot_g_mean_mag": "mag", "bp_rp": "mag", "scan_direction_mean_k2": "deg",
}  # fmt: skip


@arguments.accepts(n_five=arguments.whole, rng=arguments.seed)
def crf3(
    rng: Rng,
    signal: Signal | Coefficients | None = None,
    *,
    n_five: int = CRF3_COUNTS[31],
    n_six: int | None = None,
    traps: bool = False,
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
    traps : bool
        With what could deceive: systematic errors, partly by magnitude and by colour (`sim.gaia._link`); stars
        among the quasars; quoted errors that are too small for faint sources.

    Returns
    -------
    astropy Table
        In the columns and units of gaia_source and qso_candidates.

    Notes
    -----
    Errors and correlations are those of the scanning law over 34 months at the middle of each of 12 288 pixels, for the
    magnitude of each source; the noise of parallax and motion is drawn with their correlations. Bright quasars are
    nearer, as in SDSS (`sim.population.REDSHIFT_BY_MAGNITUDE`), redshifts are learnt from spectra and one in twenty is
    wrong altogether, and colours follow them.

    Examples
    --------
    >>> table = crf3(1, n_five=60, n_six=20)
    >>> len(table), 'pmra_pmdec_corr' in table.colnames
    (80, True)
    """
    return _simulate_catalogue(rng, signal, n_five, n_six, "DR3", traps)


#: The share of DR4's sources whose quality is flagged, and by how much their motions scatter [mas/yr]: guesses.
_FLAGGED_SHARE, _JUNK = 0.005, 5.0


@arguments.accepts(n_five=arguments.whole, rng=arguments.seed)
def crf4(
    rng: Rng,
    signal: Signal | Coefficients | None = None,
    *,
    n_five: int = CRF3_COUNTS[31],
    n_six: int | None = None,
    table: str = "gaia_source",
    traps: bool = False,
) -> Table:
    """Simulate a catalogue like the quasars of Gaia DR4, to rehearse an analysis.

    Parameters
    ----------
    rng, signal, n_five, n_six, traps
        As for `crf3`.
    table : {"gaia_source", "all_source_astrometry"}
        "gaia_source" has the best model of each source. For one quasar in 250 this is a non-single-star model, and
        the quasar is lost (the fraction is a guess). "all_source_astrometry" has the core solution of every source.

    Returns
    -------
    astropy Table
        The catalogue, in the columns of the draft data model of DR4, such as astrometric_params,
        tentative_parallax_bias and quality_flag, which is zero unless there are traps: these flag one source in 200,
        whose motions scatter by 5 mas/yr (a guess).

    Notes
    -----
    The simulation is that of `crf3`, but over the 66 months of DR4, with the errors that are expected for DR4 and at
    epoch J2017.5.

    Examples
    --------
    >>> table = crf4(1, n_five=60)
    >>> 'phot_g_mean_mag' in table.colnames
    True
    """
    arguments.choice("table", table, ("gaia_source", "all_source_astrometry"))
    rng = generator(rng)
    catalogue = _simulate_catalogue(rng, signal, n_five, n_six, "DR4", traps)
    codes = np.asarray(catalogue["astrometric_params_solved"]).copy()
    if table == "gaia_source":
        draw = rng.spawn(1)[0].random(len(catalogue))
        codes[draw < _OTHER_MODEL_SHARES[0]] = 127  # seven parameters: an acceleration
        codes[(draw >= _OTHER_MODEL_SHARES[0]) & (draw < sum(_OTHER_MODEL_SHARES))] = 511  # nine: its change as well
    catalogue["astrometric_params_solved"] = codes
    catalogue.rename_column("astrometric_params_solved", "astrometric_params")
    catalogue["tentative_parallax_bias"] = np.full(len(catalogue), ZERO_POINT, np.float32)
    catalogue["tentative_parallax_bias"].unit = "mas"
    is_flagged = rng.spawn(1)[0].random(len(catalogue)) < (_FLAGGED_SHARE if traps else 0.0)
    catalogue["quality_flag"] = is_flagged.astype(np.int16)
    for name, scatter in zip(("pmra", "pmdec"), rng.spawn(1)[0].normal(0.0, _JUNK, (2, len(catalogue))), strict=True):
        catalogue[name] += np.where(is_flagged, scatter, 0.0)
    catalogue.meta |= {"REFEPOCH": 2017.5, "RELEASE": "simulated quasars of Gaia DR4", "TABLE": table}
    return catalogue


def _simulate_catalogue(rng, signal, n_five, n_six, release, traps):
    """The table of `crf3`, or of another release."""
    from vsh.io import tables

    years = {"DR3": _DR3_YEARS, "DR4": 66 / 12}[release]
    six_count = n_five * CRF3_COUNTS[95] / CRF3_COUNTS[31] if n_six is None else arguments.not_negative("n_six", n_six)
    n = n_five + round(six_count)
    truth = acceleration((-0.235965, -3.755779, -2.080491)) if signal is None else as_signal(signal)
    # A stream of its own for each step, so that one number does not shift what another draws.
    sky_rng, light_rng, size_rng, noise_rng, property_rng, gap_rng, trap_rng = generator(rng).spawn(7)
    lon, lat = draw_positions(n, sky_rng, "gums")
    has_six = np.arange(n) >= n_five
    magnitude = draw_crf3_magnitudes(n_five, n - n_five, light_rng)
    properties = _draw_property_columns(property_rng, has_six, magnitude)
    mission = Mission(NominalScanningLaw(years=years, rng=gap_rng), release)
    pixel = pixels_of(lon, lat, _NSIDE)
    transits = mission.scanning_law.transits(*centres(_NSIDE))
    solution = solve_astrometry(transits, np.ones(12 * _NSIDE**2), 0, years=years)
    unit = solution.covariance[:, 2:, 2:]  # parallax, µ_α*, µ_δ for a transit's error of one
    unit = np.where(np.isfinite(unit), unit, np.nanmedian(unit, axis=0))
    # A little of its own for each source: transits are lost.
    size = mission.transit_error(magnitude) * np.where(has_six, SIX_PARAMETERS, 1.0) * size_rng.lognormal(0.0, 0.05, n)
    unit_error = np.sqrt(np.einsum("nii->ni", unit))
    correlation = unit / (unit_error[:, :, None] * unit_error[:, None])
    ratio = np.where(size_rng.random(n) < _OUTLIER_SHARE, _OUTLIER_FACTOR, 1.0)
    if traps:
        ratio *= find_error_inflation(magnitude)
    scatter = np.einsum("nij,nj->in", np.linalg.cholesky(unit)[pixel], noise_rng.standard_normal((n, 3))) * size * ratio
    sigma = unit_error[pixel].T * size
    motion = (truth(lon, lat) + scatter[1:]) / MAS
    if traps:
        motion += draw_systematics(lon, lat, sigma[1:], magnitude, properties["nu"], release, trap_rng) / MAS
    columns = {
        "source_id": _make_source_ids(lon, lat),
        "ra": np.degrees(lon),
        "dec": np.degrees(lat),
        "parallax": ZERO_POINT + scatter[0] / MAS,
        "parallax_error": sigma[0] / MAS,
        "pmra": motion[0],
        "pmdec": motion[1],
        "pmra_error": sigma[1] / MAS,
        "pmdec_error": sigma[2] / MAS,
        "parallax_pmra_corr": correlation[pixel, 0, 1],
        "parallax_pmdec_corr": correlation[pixel, 0, 2],
        "pmra_pmdec_corr": correlation[pixel, 1, 2],
        "astrometric_params_solved": np.where(has_six, 95, 31).astype(np.int16),
    }
    transit_columns = {name: values[pixel] for name, values in scan_columns(transits, 12 * _NSIDE**2).items()}
    del properties["nu"]
    meta = {"REFEPOCH": 2016.0, "RELEASE": "simulated Gaia-CRF3", "PLX_UAS": 1000 * ZERO_POINT}
    return tables.table_of(columns | transit_columns | properties, meta, _CRF3_UNITS)


def _draw_property_columns(rng: np.random.Generator, has_six: BoolArray, magnitude: FloatArray) -> dict[str, Any]:
    """Colours, redshifts and quality; `nu` is the wavenumber of all."""
    n = len(has_six)
    wavenumber = rng.normal(1.589, 0.06, n)
    has_redshift = rng.random(n) < 0.6
    z, ruwe, colour_scatter = quasar_redshifts(n, rng), rng.lognormal(0.0, 0.04, n), rng.normal(0, 0.1, n)
    spin_draw, order_rng, learnt_rng = rng.random(n), *rng.spawn(2)
    z = assign_redshifts(z, magnitude, order_rng)
    wavenumber += find_wavenumber_offset(z) - find_wavenumber_offset(z).mean()
    return {
        "nu": wavenumber,
        "nu_eff_used_in_astrometry": np.where(has_six, np.nan, wavenumber).astype(np.float32),
        "pseudocolour": np.where(has_six, wavenumber, np.nan).astype(np.float32),
        "ruwe": np.where(has_six, 1.044, 1.013) * ruwe.astype(np.float32),
        "phot_g_mean_mag": magnitude.astype(np.float32),
        "bp_rp": ((1.73 - wavenumber) / 0.2 + colour_scatter).astype(np.float32),
        "redshift_qsoc": np.where(has_redshift, learn_redshifts(z, learnt_rng), np.nan).astype(np.float32),
        "used_for_reference_frame_spin": ~has_six & (spin_draw < 0.353),
    }


def _make_source_ids(lon, lat):
    """Numbers as Gaia makes them: the HEALPix pixel of level 12, nested, then a running number."""
    pixel = pixels_of(lon, lat, 4096, nested=True)
    order = np.argsort(pixel, kind="stable")
    pixel_starts = np.searchsorted(pixel[order], pixel[order])
    running_number = np.empty(len(pixel), np.int64)
    running_number[order] = np.arange(len(pixel)) - pixel_starts
    return pixel.astype(np.int64) * 2**35 + (running_number + 1) * 2**7
