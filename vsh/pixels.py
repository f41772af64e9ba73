"""HEALPix: which part of the sky a source is in (the only healpy)."""

import healpy
import numpy as np

from vsh.errors import FieldError, TableError


def pixels_of(lon, lat, nside):
    """The HEALPix pixel (ring order) of each position, (n,).

    Parameters
    ----------
    lon, lat : (n,) arrays — positions [rad]
    nside : int — a power of two

    Raises
    ------
    FieldError
        If nside is no power of two, or a position is not on the sky.
    """
    check_nside(nside)
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    if not (np.isfinite(lon).all() and (np.abs(lat) <= np.pi / 2 * (1 + 1e-14)).all()):
        raise FieldError("positions are not finite, or beyond a pole")
    return healpy.ang2pix(nside, np.clip(np.pi / 2 - lat, 0, np.pi), lon)


def check_nside(nside):
    """Return nside; raise FieldError unless it is a power of two from 1 to 8192."""
    if not (isinstance(nside, (int, np.integer)) and 1 <= nside <= 8192 and nside & (nside - 1) == 0):
        raise FieldError(f"nside must be a power of two from 1 to 8192, not {nside!r}")
    return nside


def centres(nside):
    """Longitude and latitude of every pixel's centre, two (12 nside²,) arrays. [rad]"""
    theta, phi = healpy.pix2ang(check_nside(nside), np.arange(12 * nside**2))
    return phi, np.pi / 2 - theta


def random_positions(density, n, rng):
    """n positions drawn with the density of a HEALPix map, evenly within each pixel.

    Parameters
    ----------
    density : (12 nside²,) array, ring order — not negative; nan counts as none
    n : int
    rng : Generator or int

    Returns
    -------
    lon, lat : (n,) arrays [rad]

    Raises
    ------
    FieldError
        If it is no HEALPix map, or negative, or empty.
    """
    rng = np.random.default_rng(rng)
    density = np.nan_to_num(np.ma.filled(np.ma.asarray(density, float), 0.0).ravel())
    nside = round(np.sqrt(density.size / 12))
    if nside < 1 or 12 * nside**2 != density.size:
        raise FieldError(f"a map of {density.size} pixels is no HEALPix map")
    check_nside(nside)
    if (density < 0).any() or not density.sum() > 0:
        raise FieldError("the density of a map must not be negative, and not zero everywhere")
    pixel = rng.choice(density.size, n, p=density / density.sum())
    # Evenly within a pixel: one of its 4^k children, then a shift below their size. In nested order
    # a pixel's children are consecutive.
    finer = max(1, min(8192, 2**29 // nside) // nside)
    child = healpy.ring2nest(nside, pixel) * finer**2 + rng.integers(finer**2, size=n)
    theta, phi = healpy.pix2ang(nside * finer, child, nest=True)
    return phi, np.pi / 2 - theta


def read_map(path):
    """A HEALPix map from a FITS file, in ring order, and the frame its header names (or None)."""
    try:
        values, header = healpy.read_map(path, h=True)
    except (OSError, KeyError, ValueError, IndexError, TypeError) as error:
        raise TableError(f"{path} cannot be read as a HEALPix map: {error}") from error
    frames = {"C": "icrs", "G": "galactic", "E": "ecliptic", "ICRS": "icrs", "GALACTIC": "galactic"}
    named = str(dict(header).get("COORDSYS", "")).strip().upper()
    return values, frames.get(named)


def mean_map(lon, lat, values, nside):
    """The mean of the sources' values in each pixel, nan in empty ones.

    Parameters
    ----------
    lon, lat : (n,) arrays — positions [rad]
    values : (n,) or (k, n) array

    Returns
    -------
    (12 nside²,) or (k, 12 nside²) array
    """
    pixel = pixels_of(lon, lat, nside)
    count = np.bincount(pixel, minlength=12 * nside**2)
    values = np.asarray(values, float)
    sums = [np.bincount(pixel, weights=row, minlength=12 * nside**2) for row in np.atleast_2d(values)]
    with np.errstate(invalid="ignore"):
        return (np.array(sums) / np.where(count, count, np.nan)).reshape(*values.shape[:-1], -1)
