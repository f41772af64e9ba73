"""HEALPix: which part of the sky a source is in."""

import numpy as np
from ducc0.healpix import Healpix_Base

from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import FieldError
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray, Rng

__all__ = ["centres", "pixels_of"]


@arguments.accepts(
    lon=arguments.array_with_dimensions(1), lat=arguments.array_with_dimensions(1), nside=arguments.whole
)
def pixels_of(lon: ArrayLike, lat: ArrayLike, nside: int, *, nested: bool = False, any_size: bool = False) -> IntArray:
    """The HEALPix pixel of each position, (n,), in ring order unless told otherwise.

    Parameters
    ----------
    lon, lat : (n,) arrays
        Positions [rad]
    nside : int
        A power of two, to 2²⁹.
    nested : bool
        Pixels in nested order.
    any_size : bool
        Whether nside may be no power of two, in ring order.

    Raises
    ------
    FieldError
        If nside is no power of two, or a position is not on the sky.
    """
    check_nside(nside, any_size and not nested, most=2**29)
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    if lon.shape != lat.shape:
        raise FieldError(f"lon and lat have shapes {lon.shape} and {lat.shape}")
    if not (np.isfinite(lon).all() and (np.abs(lat) <= np.pi / 2 * (1 + 1e-14)).all()):
        raise FieldError("positions are not finite, or beyond a pole")
    positions = np.stack([np.clip(np.pi / 2 - lat, 0, np.pi), lon % (2 * np.pi)], axis=1)
    return Healpix_Base(int(nside), "NEST" if nested else "RING").ang2pix(positions)


def check_nside(nside: int, any_size: bool = False, most: int = 8192) -> int:
    """Return nside; raise FieldError unless it is a power of two, or any whole number where that is allowed.

    Maps have at most nside 8192; a pixel alone may be one of any that HEALPix numbers, up to 2²⁹.
    """
    if isinstance(nside, (int, np.integer)) and 1 <= nside <= most and (any_size or nside & (nside - 1) == 0):
        return nside
    noun = "whole number" if any_size else "power of two"
    raise FieldError(f"nside must be a {noun} from 1 to {most}, not {nside!r}")


def centres(nside: int, *, any_size: bool = False) -> tuple[FloatArray, FloatArray]:
    """Longitude and latitude of every pixel's centre, two (12 nside²,) arrays. [rad]

    Parameters
    ----------
    nside : int
        Resolution of the HEALPix pixels.
    any_size : bool
        Whether nside may be no power of two.
    """
    theta, phi = Healpix_Base(int(check_nside(nside, any_size)), "RING").pix2ang(np.arange(12 * nside**2)).T
    return phi, np.pi / 2 - theta


@arguments.accepts(density=arguments.array_with_dimensions(1), n=arguments.whole, rng=arguments.seed)
def draw_map_positions(density: ArrayLike, n: int, rng: Rng) -> tuple[FloatArray, FloatArray]:
    """n positions drawn with the density of a HEALPix map, evenly within each pixel."""
    rng = generator(rng)
    density = np.ma.filled(np.ma.asarray(density, float), 0.0).ravel()
    if np.isinf(density).any():
        raise FieldError(f"{np.isinf(density).sum()} pixels of the map are infinite: all sources would stand there")
    density = np.where(is_valueless(density), 0.0, density)
    nside = round(np.sqrt(density.size / 12))
    if nside < 1 or 12 * nside**2 != density.size:
        raise FieldError(f"a map of {density.size} pixels is no HEALPix map")
    check_nside(nside)
    if (density < 0).any() or not density.sum() > 0:
        raise FieldError("the density of a map must not be negative, and not zero everywhere")
    pixels = rng.choice(density.size, n, p=density / density.sum())
    # Evenly within a pixel: one of its 4^k children, then a shift below their size. In nested order
    # a pixel's children are consecutive.
    nside_ratio = max(1, min(8192, 2**29 // nside) // nside)
    child_pixels = Healpix_Base(nside, "RING").ring2nest(pixels) * nside_ratio**2 + rng.integers(nside_ratio**2, size=n)
    theta, phi = Healpix_Base(nside * nside_ratio, "NEST").pix2ang(child_pixels).T
    return phi, np.pi / 2 - theta


def count_missing_pixels(values: ArrayLike) -> int:
    """Count the pixels of a map without a value: nan, masked, or healpy's UNSEEN."""
    return int(is_valueless(np.ma.filled(np.ma.asarray(values, float), np.nan)).sum())


def is_valueless(values: FloatArray) -> BoolArray:
    """Find the pixels without a value: nan, or healpy's UNSEEN."""
    return np.isnan(values) | (values < -1e30)


def smooth_map(values: ArrayLike, width: float) -> FloatArray:
    """A map smoothed by a Gaussian; its sum stays, to a thousandth."""
    import healpy  # slow to import, with matplotlib

    return np.asarray(healpy.smoothing(np.asarray(values, float), fwhm=np.radians(width)))


def mean_map(lon: ArrayLike, lat: ArrayLike, values: ArrayLike, nside: int) -> FloatArray:
    """The mean of the sources' values in each pixel, nan in empty ones."""
    pixels = pixels_of(lon, lat, nside)
    counts = np.bincount(pixels, minlength=12 * nside**2)
    values = np.asarray(values, float)
    sums = [np.bincount(pixels, weights=row, minlength=12 * nside**2) for row in np.atleast_2d(values)]
    with np.errstate(invalid="ignore"):
        return (np.array(sums) / np.where(counts, counts, np.nan)).reshape(*values.shape[:-1], -1)
