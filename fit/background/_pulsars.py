"""Pulsar timing beside motions: one likelihood of the energy in gravitational waves."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from fit.background._amplitude import Amplitude
from fit.background._waves import MPC, WaveLimit
from vsh.io import tables
from vsh.io.catalogue import missing_column, unit_factor
from vsh.models.waves import hellings_downs
from vsh.tools import arguments
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.types import FloatArray
from vsh.tools.units import DEGREE, JULIAN_YEAR

_COLUMNS = ("first", "second", "angle", "power", "noise")
#: Points of the grid of amplitudes, and how far it goes in the largest power of a pulsar.
_POINTS, _REACH = 801, 5.0
#: Factors on the noise of all pulsars that are marginalised, alike in their logarithm.
_FACTORS = np.geomspace(0.5, 2.0, 57)


def add_pulsars(
    limit: WaveLimit,
    pairs: Any,
    years: float,
    bins: float,
    *,
    frequency: float = 1.0,
    slope: float = 2 / 3,
    lowest: float = 0.0,
) -> WaveLimit:
    """Add the cross-powers of all pairs of an array of pulsars to what motions tell of gravitational waves.

    Parameters
    ----------
    limit : WaveLimit
        What the motions tell, from `wave_limit`.
    pairs : path or table
        A row for each pair, of a pulsar with itself too: the names of both, `first` and `second`, the `angle` between
        them [deg], and the real part of the cross-power `power` of their residuals in units of h_c², the squared
        characteristic strain of waves at `frequency`: on average Γ h_c² for two pulsars, Γ that of
        `vsh.models.waves.hellings_downs`, and h_c² and the noise for one. Rows of one pulsar have that `noise`.
    years : float
        T, over which the motions were measured: they tell of waves with f < 1/T. [yr]
    bins : float
        k, number of bins of frequency that a cross-power is the mean of.
    frequency : float
        Frequency that the cross-powers are for. [1/yr]
    slope : float
        n of Ω ∝ fⁿ: 2/3 for black holes in orbits that decay by their waves alone.
    lowest : float
        Frequency below which there are no waves, needed for a slope of zero or less. [1/yr]

    Returns
    -------
    WaveLimit
        From both: Ω is still that of all waves with f < 1/T, ∫ Ω(f) d ln f. A note has what the pulsars tell alone, and
        the ratio of Ω at `frequency`.

    Raises
    ------
    TableError
        If a column is missing or holds no numbers.
    ParameterError
        If a pair is missing or stands there twice, a noise is not above zero, or the waves have no lowest frequency.

    Notes
    -----
    Amplitudes of residuals are Gaussian, so that cross-powers S have the Wishart likelihood −k (ln |C| + tr C⁻¹ S) with
    C = Γ h_c² + noise: exact for waves of any strength. A factor from ½ to 2 on the noise of all pulsars is
    marginalised, because a noise that all have too small would pass for waves; one that is wrong by 10 % from pulsar to
    pulsar does little harm (docs/validation.md). Ω(f) = 2π² f² h_c²/(3 H0²), and the motions tell of ∫ Ω d ln f below
    1/T: both are of one power law, and with another spectrum they cannot be added.

    References
    ----------
    Hellings & Downs 1983, ApJ 265, L39; Book & Flanagan 2011, PRD 83, 024024; Jiménez Cruz et al. 2024,
    arXiv:2412.14010.
    """
    arguments.a(WaveLimit)("limit", limit)
    years, slope = arguments.positive("years", years), arguments.number("slope", slope)
    lowest = arguments.not_negative("lowest", lowest)
    if lowest >= 1 / years or (slope <= 0 and lowest == 0):
        raise ParameterError(
            f"Ω ∝ f^{slope:g} from {lowest:g} to {1 / years:g} per year has no finite energy: name the lowest frequency"
        )
    frequency, bins = arguments.positive("frequency", frequency), arguments.positive("bins", bins)
    curve, products, noise = _matrices(pairs)
    # Ω of the motions' band for a squared strain of one.
    rate = limit.hubble / MPC * JULIAN_YEAR
    upper, lower = np.log(1 / (years * frequency)), np.log(max(lowest, 1e-300) / frequency)
    share = upper - lower if slope == 0 else (np.exp(slope * upper) - np.exp(slope * lower)) / slope
    band = 2 * np.pi**2 * frequency**2 / (3 * rate**2) * share
    own = np.linspace(0, 1, _POINTS) ** 1.5 * np.sqrt(_REACH * np.diag(products).max())
    unit = np.sqrt(np.outer(noise, noise))
    values, vectors = np.linalg.eigh(curve / unit)
    shares = np.sum(vectors * (products / unit @ vectors), axis=0)
    spread = _FACTORS[:, None, None] + np.multiply.outer(own**2, values)
    alone = logsumexp(-bins * np.sum(np.log(spread) + shares / spread, axis=2), axis=0)
    own = own * np.sqrt(band)
    root = np.union1d(limit.amplitude.root[limit.amplitude.root < own[-1]], own)
    motions = limit.amplitude
    log = np.interp(root, motions.root, motions.log_likelihood, right=-np.inf) + np.interp(root, own, alone)
    inside = log > log.max() - 700
    pulsars = Amplitude(own, alone - alone.max())
    name = "h70² Ω" if limit.hubble == 70 else "Ω"
    low, high = pulsars.interval(0.68)
    alone_in_words = f"{name} = {pulsars.maximum:.3g} ({low:.3g} … {high:.3g}, 68 %)"
    note = (
        f"waves: with {len(curve)} pulsars at {frequency:.3g} per year, which alone give {alone_in_words} in the band "
        f"of the motions for Ω ∝ f^{slope:.3g}; at that frequency it is {1 / share:.3g} times as much"
    )
    amplitude = Amplitude(root[inside], log[inside] - log.max())
    # A limit from the coefficients of degree 2 alone knows nothing of pulsars.
    squares = np.full_like(limit.squares, np.nan)
    return replace(
        limit, amplitude=amplitude, years=years, squares=squares, pulsars=len(curve), notes=(*limit.notes, note)
    )


def _matrices(pairs: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Γ, one on the diagonal, and the cross-powers, (n, n); the noise of each pulsar, (n,)."""
    table = tables.open_table(pairs)
    missing = [name for name in _COLUMNS if name not in table.names]
    if missing:
        raise TableError(f"{table.label}: {missing_column(missing[0], table)}")
    first, second, angle, power, noise = (np.asarray(table.columns((name,))[name][0]) for name in _COLUMNS)
    names, place = np.unique(np.concatenate([first, second]), return_inverse=True)
    n, (i, j) = len(names), place.reshape(2, -1)
    angle = np.asarray(angle, float) * unit_factor("angle", table.units.get("angle"), "deg") * DEGREE
    power, noise, is_one = np.asarray(power, float), np.asarray(noise, float), i == j
    bad = ~(np.isfinite(angle) & np.isfinite(power)) | (is_one & ~(noise > 0))
    if bad.any():
        raise ParameterError(f"{table.label}: {bad.sum()} of {len(bad)} rows have no angle, power, or noise above zero")
    counts = np.zeros((n, n), int)
    np.add.at(counts, (np.minimum(i, j), np.maximum(i, j)), 1)
    if wrong := int(np.abs(counts[np.triu_indices(n)] - 1).sum()):
        raise ParameterError(
            f"{table.label}: every pair of {n} pulsars must stand there once, each with itself too, {n * (n + 1) // 2} "
            f"rows in all: {wrong} are missing or stand there twice"
        )
    curve, products = np.zeros((n, n)), np.zeros((n, n))
    for rows in ((i, j), (j, i)):
        curve[rows], products[rows] = np.where(is_one, 1.0, hellings_downs(angle)), power
    return curve, products, noise[is_one][np.argsort(i[is_one])]
