"""What real catalogues of quasars have and simulated ones lack: whatever could pass for the sky.

Redshift, magnitude and colour hang together; redshifts are learnt; and, on request, sources share errors that differ by
magnitude and colour, some are stars, and the errors of faint ones are too small.
"""

import numpy as np

from sim.scanning import Transits
from sim.signal import systematics
from vsh.models.covariance import LINDEGREN_2021, Spectrum
from vsh.tools.types import FloatArray

#: By how much what sources share is smaller than Gaia EDR3 published (Lindegren et al. 2021), whose quasars show about
#: a third of it; as proper motions improve, with the mission's length to the power of 1.5.
TRAPS = {"DR3": 1 / 3, "DR4": (34 / 66) ** 1.5 / 3}
#: Its parts: the same for all sources, of the faint, of the blue. Their squares add up to one for those that have all.
_COMMON, _OWN = np.sqrt(0.5), np.sqrt(0.25)
#: Stars whose motions are within five errors pass for quasars (Klioner et al. 2022, sect. 2); how many is a guess.
_STARS, _WITHIN = 0.005, 5.0
#: Quoted errors are too small by a tenth at the faint end: a guess.
_FAINT, _TOO_SMALL = (17.0, 21.0), 0.1
#: Error of a learnt redshift, and the share of those that are wrong altogether.
_LEARNT, _WRONG = 0.1, 0.05
#: Visibility periods are groups of transits that are so many days apart.
_PERIOD = 4.0 / 365.25


def colour_of(z: FloatArray) -> FloatArray:
    """How the wavenumber follows the redshift [µm⁻¹]: emission lines, and no light beyond Lyman α from z = 2.5.

    A stand-in of the right size, of no table.
    """
    return 0.02 * np.cos(2 * np.pi * z / 0.9) - 0.05 * np.maximum(z - 2.5, 0.0)


def learnt_redshifts(z: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Redshifts as a machine reads them from spectra: an error of 0.1, and one in twenty another source's."""
    wrong = rng.random(len(z)) < _WRONG
    return np.maximum(np.where(wrong, rng.permutation(z), z + rng.normal(0, _LEARNT, len(z))), 0.01)


def scan_columns(transits: Transits, n: int) -> dict[str, FloatArray]:
    """Visibility periods, transits, and the second moment of scan directions of n places, as Gaia has them."""
    counts = transits.counts(n)
    new = np.ones(len(transits), bool)
    new[1:] = (np.diff(transits.source) != 0) | (np.diff(transits.time) > _PERIOD)
    moment = np.bincount(transits.source, np.cos(2 * transits.angle), n) + 1j * np.bincount(
        transits.source, np.sin(2 * transits.angle), n
    )
    moment = moment / np.maximum(counts, 1)
    return {
        "visibility_periods_used": np.bincount(transits.source, new, n).astype(np.int16),
        "matched_transits": counts.astype(np.int16),
        "scan_direction_strength_k2": np.abs(moment).astype(np.float32),
        "scan_direction_mean_k2": np.degrees(np.angle(moment) / 2).astype(np.float32),
    }


def too_small(magnitude: FloatArray) -> FloatArray:
    """True errors over quoted ones."""
    low, high = _FAINT
    return 1 + _TOO_SMALL * np.clip((magnitude - low) / (high - low), 0, 1)


def deception(
    lon: FloatArray, lat: FloatArray, sigma: FloatArray, magnitude: FloatArray, wavenumber: FloatArray, release: str,
    rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Motions that sources share, by all, magnitude and colour, and those of stars; (2, n). [µas/yr]"""
    shared, stars = rng.spawn(2)
    spectrum = TRAPS[release] ** 2 * Spectrum.from_covariance(LINDEGREN_2021)
    motion = _COMMON * systematics(spectrum, shared)(lon, lat)
    for values, high in ((magnitude, np.median(magnitude)), (wavenumber, np.median(wavenumber))):
        motion += _OWN * systematics(spectrum, shared)(lon, lat) * (values > high)
    chosen = np.flatnonzero(stars.random(len(lon)) < _STARS)
    angle, radius = stars.uniform(0, 2 * np.pi, len(chosen)), _WITHIN * np.sqrt(stars.random(len(chosen)))
    motion[:, chosen] += np.stack([np.cos(angle), np.sin(angle)]) * radius * sigma[:, chosen]
    return motion
