"""Radio stars and quasars as Gaia and VLBI see them, and what real catalogues of quasars have beside the truth.

Frames are turned by a known amount. Redshift, magnitude and colour hang together; redshifts are learnt; and, on
request, sources share errors that differ by magnitude and colour, some are stars, and the errors of faint ones are too
small.
"""

from collections.abc import Callable
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from sim.astrometry import parallax_error
from sim.scanning import Transits
from sim.signal import systematics
from vsh.models.covariance import LINDEGREN_2021, Spectrum
from vsh.sky.astrometry import AstrometryRows, earth, propagate
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.types import FloatArray, Rng
from vsh.tools.units import AU_PER_YEAR, UAS
from vsh.vector import Vector

#: Gaia's errors in units of that of the parallax: α*, δ, ϖ, µ_α*, µ_δ (Lindegren et al. 2021, A&A 649, A2).
_GAIA_FACTORS = np.array([0.8, 0.75, 1.0, 1.03, 0.9])
#: Errors of VLBI: median position [µas], parallax [µas], motion times the span [µas], and their spread in dex.
_VLBI_ERRORS, _VLBI_DEX = np.array([120.0, 120.0, 60.0, 180.0, 180.0]), 0.3
#: Epochs that VLBI was made at, and spans of it. [yr]
_VLBI_EPOCHS, _VLBI_SPANS = (1992.0, 2018.0), (1.0, 8.0)
#: Orbits of binaries: offsets of position [µas] and of motion [µas/yr], each coordinate.
_ORBIT = 1500.0, 700.0
_GAIA_EPOCH, _FIXED_EPOCH = 2016.0, 2015.0


@arguments.accepts(rng=arguments.seed, n=arguments.whole, epochs=arguments.whole)
def link(
    rng: Rng,
    n: int = 40,
    *,
    orientation: Any = (0.0, 0.0, 0.0),
    spin: Any = (0.0, 0.0, 0.0),
    jump: Any = (0.0, 0.0, 0.0),
    step: float = 13.0,
    frame: Callable[[FloatArray], tuple[FloatArray, FloatArray]] | None = None,
    binaries: float = 0.1,
    single: float = 0.0,
    epochs: int = 4,
    quasars: int = 0,
    offset: float = 0.0,
    star_offset: float = 0.0,
    calibrators: int = 0,
    calibrator_error: float = 0.0,
    wrong: float = 1.0,
    tails: float = np.inf,
    aberration: Vector | None = None,
) -> AstrometryRows:
    """Simulate stars with radio emission, and quasars, in the catalogues "gaia" and "vlbi".

    Parameters
    ----------
    rng : Generator or int
        The source of all randomness.
    n : int
        Stars, of G = 4 to 17 mag.
    orientation, spin : (3,) arrays
        Those of Gaia's frame against VLBI's at 2016.0, for stars and quasars brighter than `step`. [µas, µas/yr]
    jump : (3,) array
        What the spin of those that are fainter is more. [µas/yr]
    step : float
        [mag]
    frame : callable, optional
        From magnitudes (k,) to orientation and spin, (3, k) each, in place of these four.
    binaries : float
        Share of stars whose VLBI position and motion are off by an orbit.
    single : float
        Share of stars that VLBI saw at single epochs, their positions displaced by the parallax.
    epochs : int
        How many of these each has.
    quasars : int
        Quasars that have positions in both, of G = 15 to 20.5.
    offset : float
        Standard deviation of what radio and optical positions of quasars are apart, a coordinate. [µas]
    star_offset : float
        The same of stars. [µas]
    calibrators : int
        How many calibrators the stars were measured against, in turn; one of its own for each where zero.
    calibrator_error : float
        Standard deviation of a calibrator's position, a coordinate: an offset of all its stars. [µas]
    wrong : float
        By how much all errors are larger than quoted.
    tails : float
        Degrees of freedom of Student's t that errors of a source are drawn from.
    aberration : Vector, optional
        Acceleration of the Solar System, which VLBI of stars does not see: its calibrators stand still from 2015.0 on.

    Returns
    -------
    AstrometryRows
        Rows of "gaia" at 2016.0, then of "vlbi".

    Examples
    --------
    >>> rows = link(1, 10, spin=(20, 0, 0), quasars=2)
    >>> rows.catalogues, len(rows)
    (('gaia', 'vlbi'), 24)
    """
    rng = generator(rng)
    n_all = n + quasars
    still = np.arange(n_all) >= n
    lon, lat = rng.uniform(0, 2 * np.pi, n_all), np.arcsin(rng.uniform(-1, 1, n_all))
    magnitude = np.where(still, rng.uniform(15, 20.5, n_all), rng.uniform(4, 17, n_all))
    parallax = np.where(still, 0.0, 1e6 / 10 ** rng.uniform(1.2, 3.2, n_all))
    motion = np.where(still, 0.0, 20 / AU_PER_YEAR * parallax * rng.standard_normal((2, n_all)))
    velocity = np.where(still, 0.0, 20 * rng.standard_normal(n_all))
    glide = np.zeros(3) if aberration is None else aberration.to_frame("icrs").value
    p, q, _ = triad(lon, lat)
    motion += np.where(still, np.stack([glide @ p, glide @ q]), 0.0)
    if frame is None:
        orientations = np.tile(np.asarray(orientation, float)[:, None], n_all)
        spins = np.asarray(spin, float)[:, None] + np.asarray(jump, float)[:, None] * (magnitude >= step)
    else:
        orientations, spins = frame(magnitude)
    truth = np.vstack([lon, lat, parallax, motion])
    error_factor = wrong * np.ones(n_all)
    if np.isfinite(tails):
        error_factor /= np.sqrt(rng.chisquare(tails, n_all) / tails)
    shift = np.zeros((5, n_all))
    binary = ~still & (rng.uniform(size=n_all) < binaries)
    shift[:2] = _ORBIT[0] * rng.standard_normal((2, n_all)) * binary + offset * rng.standard_normal((2, n_all)) * still
    shift[3:] = _ORBIT[1] * rng.standard_normal((2, n_all)) * binary
    group_index = np.where(still, -1, np.arange(n_all) % calibrators if calibrators else np.arange(n_all))
    if star_offset:
        shift[:2] += star_offset * rng.standard_normal((2, n_all)) * ~still
    if calibrator_error:
        shift[:2] += (calibrator_error * rng.standard_normal((2, group_index.max() + 1)))[:, group_index] * ~still
    calibrator_names = np.where(still | (calibrators == 0), "", np.char.add("calibrator ", group_index.astype(str)))

    sigma = _GAIA_FACTORS[:, None] * parallax_error(np.maximum(magnitude, 9.0))
    correlation_root = np.linalg.cholesky(np.eye(5) + 0.3 * (np.ones((5, 5)) - np.eye(5)))
    gaia_offsets = sigma * (correlation_root @ rng.standard_normal((5, n_all))) * error_factor
    gaia_offsets[:2] += np.stack([np.sum(q * orientations, 0), -np.sum(p * orientations, 0)])
    gaia_offsets[3:] += np.stack([np.sum(q * spins, 0), -np.sum(p * spins, 0)])
    covariance = (correlation_root @ correlation_root.T)[None] * sigma.T[:, :, None] * sigma.T[:, None, :]
    row_sets = [(np.arange(n_all), np.full(n_all, _GAIA_EPOCH), "gaia", truth, gaia_offsets, covariance)]

    vlbi_factor = 10 ** (_VLBI_DEX * rng.standard_normal(n_all))
    is_single_epoch = ~still & (rng.uniform(size=n_all) < single)
    epoch = np.where(still, _FIXED_EPOCH, rng.uniform(*_VLBI_EPOCHS, n_all))
    sigma = _VLBI_ERRORS[:, None] * vlbi_factor
    sigma[3:] /= rng.uniform(*_VLBI_SPANS, n_all)
    for k in range(epochs if is_single_epoch.any() else 1):
        indices = np.flatnonzero(is_single_epoch if k else np.ones(n_all, bool))
        t = (epoch + np.where(is_single_epoch, k * 0.37, 0.0))[indices]
        epoch_truth, _ = propagate(truth[:, indices], velocity[indices], _GAIA_EPOCH, t)
        east, north, _ = triad(epoch_truth[0], epoch_truth[1])
        offsets = sigma[:, indices] * rng.standard_normal((5, len(indices))) * error_factor[indices] + shift[:, indices]
        offsets[:2] += shift[3:, indices] * (t - _GAIA_EPOCH)
        is_single = is_single_epoch[indices]
        observer = earth(t)
        offsets[:2] -= is_single * epoch_truth[2] * np.stack([np.sum(east * observer, 0), np.sum(north * observer, 0)])
        is_star = ~still[indices]
        offsets[:2] -= is_star * (t - _FIXED_EPOCH) * np.stack([glide @ east, glide @ north])
        offsets[3:] -= is_star * np.stack([glide @ east, glide @ north])
        variance = sigma[:, indices] ** 2
        variance[2:, is_single | still[indices]] = np.nan
        epoch_truth[2:, is_single | still[indices]] = np.nan
        row_sets.append((indices, t, "vlbi", epoch_truth, offsets, variance.T[:, :, None] * np.eye(5)))
    return _make_catalogue_rows(row_sets, magnitude, velocity, still, calibrator_names)


def _make_catalogue_rows(row_sets, magnitude, velocity, still, calibrator_names):
    """Rows of both catalogues, errors added to what is true."""
    blocks = []
    for indices, t, label, truth, offset, covariance in row_sets:
        p, q, r = triad(truth[0], truth[1])
        lon, lat = angles(r + UAS * (p * offset[0] + q * offset[1]))
        names = np.where(still[indices], "quasar ", "star ").astype(object) + indices.astype(str)
        is_finite = np.isfinite(np.diagonal(covariance, axis1=1, axis2=2))
        blocks += [AstrometryRows(
            names.astype(str), np.full(len(indices), label), t, lon, lat, truth[2] + offset[2], truth[3:] + offset[3:],
            np.where(is_finite[:, :, None] & is_finite[:, None, :], covariance, np.nan),
            radial_velocity=velocity[indices], magnitude=magnitude[indices], still=still[indices],
            calibrator=calibrator_names[indices] if label == "vlbi" else None,
        )]  # fmt: skip
    return reduce(add, blocks)


#: By how much systematic errors are smaller than Gaia EDR3 published (Lindegren et al. 2021), whose quasars show about
#: a third of it; as proper motions improve, with the mission's length to the power of 1.5.
TRAPS = {"DR3": 1 / 3, "DR4": (34 / 66) ** 1.5 / 3}
#: Its parts: the same for all sources, of the faint, of the blue. Their squares add up to one for those that have all.
_COMMON_FACTOR, _OWN_FACTOR = np.sqrt(0.5), np.sqrt(0.25)
#: Stars whose motions are within five errors pass for quasars (Klioner et al. 2022, sect. 2); how many is a guess.
_STAR_SHARE, _MAX_SIGMAS = 0.005, 5.0
#: Quoted errors are too small by a tenth at the faint end: a guess.
_FAINT_RANGE, _FAINT_INFLATION = (17.0, 21.0), 0.1
#: Error of a learnt redshift, and the share of those that are wrong altogether.
_LEARNT_ERROR, _WRONG_SHARE = 0.1, 0.05
#: Visibility periods are groups of transits that are so many days apart.
_PERIOD_GAP = 4.0 / 365.25


def find_wavenumber_offset(z: FloatArray) -> FloatArray:
    """Wavenumber by redshift [µm⁻¹]: emission lines, and no light beyond Lyman α from z = 2.5.

    A stand-in of the right size, of no table.
    """
    return 0.02 * np.cos(2 * np.pi * z / 0.9) - 0.05 * np.maximum(z - 2.5, 0.0)


def learn_redshifts(z: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Redshifts as a machine reads them from spectra: an error of 0.1, and one in twenty another source's."""
    is_wrong = rng.random(len(z)) < _WRONG_SHARE
    return np.maximum(np.where(is_wrong, rng.permutation(z), z + rng.normal(0, _LEARNT_ERROR, len(z))), 0.01)


def scan_columns(transits: Transits, n: int) -> dict[str, FloatArray]:
    """Visibility periods, transits, and the second moment of scan directions of n places, as Gaia has them."""
    counts = transits.counts(n)
    is_period_start = np.ones(len(transits), bool)
    is_period_start[1:] = (np.diff(transits.source) != 0) | (np.diff(transits.time) > _PERIOD_GAP)
    moment = np.bincount(transits.source, np.cos(2 * transits.angle), n) + 1j * np.bincount(
        transits.source, np.sin(2 * transits.angle), n
    )
    moment = moment / np.maximum(counts, 1)
    return {
        "visibility_periods_used": np.bincount(transits.source, is_period_start, n).astype(np.int16),
        "matched_transits": counts.astype(np.int16),
        "scan_direction_strength_k2": np.abs(moment).astype(np.float32),
        "scan_direction_mean_k2": np.degrees(np.angle(moment) / 2).astype(np.float32),
    }


def find_error_inflation(magnitude: FloatArray) -> FloatArray:
    """True errors over quoted ones."""
    lower, upper = _FAINT_RANGE
    return 1 + _FAINT_INFLATION * np.clip((magnitude - lower) / (upper - lower), 0, 1)


def draw_systematics(
    lon: FloatArray, lat: FloatArray, sigma: FloatArray, magnitude: FloatArray, wavenumber: FloatArray, release: str,
    rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Motions that sources share, by all, magnitude and colour, and those of stars; (2, n). [µas/yr]"""
    systematics_rng, star_rng = rng.spawn(2)
    spectrum = TRAPS[release] ** 2 * Spectrum.from_covariance(LINDEGREN_2021)
    motion = _COMMON_FACTOR * systematics(spectrum, systematics_rng)(lon, lat)
    for property_values, threshold in ((magnitude, np.median(magnitude)), (wavenumber, np.median(wavenumber))):
        motion += _OWN_FACTOR * systematics(spectrum, systematics_rng)(lon, lat) * (property_values > threshold)
    indices = np.flatnonzero(star_rng.random(len(lon)) < _STAR_SHARE)
    angle, radius = star_rng.uniform(0, 2 * np.pi, len(indices)), _MAX_SIGMAS * np.sqrt(star_rng.random(len(indices)))
    motion[:, indices] += np.stack([np.cos(angle), np.sin(angle)]) * radius * sigma[:, indices]
    return motion
