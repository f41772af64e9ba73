"""Directions: unit vectors and angles on the sphere."""

import numpy as np


def triad(lon, lat):
    """The local axes p (east), q (north) and r (outwards) at each position.

    Parameters
    ----------
    lon, lat : (n,) arrays — positions [rad]

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
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    sin_lon, cos_lon, sin_lat, cos_lat = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
    p = np.stack([-sin_lon, cos_lon, np.zeros_like(lon)])
    q = np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    r = np.stack([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    return p, q, r


def angles(r):
    """Longitude in [0, 2π) and latitude of vectors of any length, (3, …). [rad]

    Accurate next to the poles, where the arcsine of r_z is not.
    """
    x, y, z = r
    lon = np.arctan2(y, x) % (2 * np.pi)
    # A tiny negative angle rounds up to 2π itself.
    return np.where(lon < 2 * np.pi, lon, 0.0), np.arctan2(z, np.hypot(x, y))
