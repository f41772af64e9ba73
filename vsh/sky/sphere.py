"""Directions: unit vectors and angles on the sphere."""

from functools import cache

import numpy as np

from vsh.tools.arguments import in_unit
from vsh.tools.subsample import select_share
from vsh.tools.types import ArrayLike, FloatArray

__all__ = ["angles", "triad"]


def triad(lon: ArrayLike, lat: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The local axes p (east), q (north) and r (outwards) at each position.

    Parameters
    ----------
    lon, lat : (n,) arrays
        Positions [rad], or Quantities.

    Returns
    -------
    p, q, r : (3, n) arrays
        Right-handed: p × q = r.

    Examples
    --------
    >>> p, q, r = triad(np.array([0.0]), np.array([0.0]))
    >>> p[:, 0], q[:, 0], r[:, 0]
    (array([-0.,  1.,  0.]), array([-0., -0.,  1.]), array([1., 0., 0.]))
    """
    lon, lat = np.asarray(in_unit("lon", lon), float), np.asarray(in_unit("lat", lat), float)
    sin_lon, cos_lon, sin_lat, cos_lat = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
    p = np.stack([-sin_lon, cos_lon, np.zeros_like(lon)])
    q = np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    r = np.stack([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    return p, q, r


def local_components(vector: FloatArray, lon: ArrayLike, lat: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Vectors at positions as components east and north, (2, n), and outwards, (n,)."""
    p, q, r = triad(lon, lat)
    return np.stack([np.sum(vector * p, 0), np.sum(vector * q, 0)]), np.sum(vector * r, 0)


def sin_cos(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine by the tangent of half the angle, to 3e-16: NumPy's tangent is up to fourteen times as fast."""
    t = np.tan(x / 2)
    square = t * t
    scale = 1 / (1 + square)
    t *= scale
    t *= 2
    square = np.subtract(1, square, out=square if np.ndim(square) else None)
    square *= scale
    return t, square


def cos_sin_multiples(x: FloatArray, max_k: int) -> tuple[FloatArray, FloatArray]:
    """cos kx and sin kx for k = 1 … max_k: two (max_k, n) arrays, by doubling."""
    cos, sin = np.empty((max_k, *np.shape(x))), np.empty((max_k, *np.shape(x)))
    sin[0], cos[0] = sin_cos(x)
    k = 1
    while k < max_k:
        upper = slice(k, min(2 * k, max_k))
        lower = slice(0, upper.stop - k)
        cos[upper] = cos[lower] * cos[k - 1] - sin[lower] * sin[k - 1]
        sin[upper] = sin[lower] * cos[k - 1] + cos[lower] * sin[k - 1]
        k *= 2
    return cos, sin


def angles(r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitude in [0, 2π) and latitude of vectors of any length, (3, …). [rad]

    Accurate next to the poles, where the arcsine of r_z is not.

    Parameters
    ----------
    r : (3, n) array
        Directions.
    """
    x, y, z = r
    lon = np.arctan2(y, x) % (2 * np.pi)
    # A tiny negative angle rounds up to 2π itself.
    return np.where(lon < 2 * np.pi, lon, 0.0), np.arctan2(z, np.hypot(x, y))


def widest_gap(lon: FloatArray, lat: FloatArray, most: int = 10_000) -> tuple[float, float, float]:
    """Radius of the largest part of the sky without any of the given directions, to some 5°, and its centre. [rad]

    Parameters
    ----------
    lon, lat : (n,) arrays
        Directions. [rad]
    most : int
        How many are looked at; the gap of fewer is as wide or wider.
    """
    selection = select_share(most / max(len(lon), 1), lon, lat)
    directions = _make_spiral_directions()
    nearest_cosines = (triad(lon[selection], lat[selection])[2].T @ directions).max(0, initial=-1.0)
    widest_index = int(nearest_cosines.argmin())
    gap_lon, gap_lat = angles(directions[:, widest_index])
    return float(np.arccos(np.clip(nearest_cosines[widest_index], -1, 1))), float(gap_lon), float(gap_lat)


@cache
def _make_spiral_directions():
    """Make directions on a spiral of Fibonacci's over the whole sky, (3, 600)."""
    k = np.arange(600) + 0.5
    z, turn = 1 - k / 300, np.pi * (1 + np.sqrt(5)) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
