"""Five parameters of stars from one epoch to another, with the derivatives: space motion, and the Earth's place."""

import warnings

import erfa
import numpy as np

from vsh.sky.sphere import angles, triad
from vsh.tools.types import ArrayLike, FloatArray
from vsh.tools.units import AU_PER_YEAR, UAS

__all__ = ["earth", "propagate"]

_ARCSEC = UAS * 1e6


def propagate(
    parameters: ArrayLike, radial_velocity: ArrayLike, start: ArrayLike, end: ArrayLike, *, light_time: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Carry five parameters of stars from one epoch to another, along straight lines in space.

    Parameters
    ----------
    parameters : (5, n) array
        Right ascension and declination [rad], parallax [µas], µ_α* and µ_δ [µas/yr], at `start`.
    radial_velocity : (n,) array
        [km/s]
    start, end : (n,) arrays
        Epochs. [Julian year]
    light_time : bool
        Whether the time that light needs to the star changes its motion (ERFA's `pmsafe`); otherwise by the model of
        ESA SP-1200, vol. 1, sect. 1.5.5, which leaves it out.

    Returns
    -------
    parameters : (5, n) array
        The same at `end`.
    jacobian : (n, 5, 5) array
        Derivatives of Δα*, Δδ, ϖ, µ_α*, µ_δ at `end` by those at `start`. [µas, µas/yr]

    Notes
    -----
    Derivatives are those of SP-1200's model, in the local axes of either epoch.
    """
    lon, lat, parallax, *motion = np.asarray(parameters, float)
    velocity, start, end = (np.broadcast_to(np.asarray(x, float), lon.shape) for x in (radial_velocity, start, end))
    t = end - start
    p, q, r = triad(lon, lat)
    # Everything in units of the distance at the start: b is where the star is then.
    zeta = velocity * parallax * UAS / AU_PER_YEAR
    moving = (p * motion[0] + q * motion[1]) * UAS
    b, rate = r * (1 + zeta * t) + moving * t, r * zeta + moving
    f = 1 / np.linalg.norm(b, axis=0)
    r_end = b * f
    away = np.sum(r_end * rate, 0)
    across = f * (rate - r_end * away)
    if light_time:
        later = _with_light_time(lon, lat, parallax, motion, velocity, start, end)
    else:
        new_lon, new_lat = angles(r_end)
        p_end, q_end, _ = triad(new_lon, new_lat)
        later = np.stack(
            [new_lon, new_lat, parallax * f, np.sum(p_end * across, 0) / UAS, np.sum(q_end * across, 0) / UAS]
        )
    p_end, q_end, _ = triad(later[0], later[1])
    jacobian = np.empty((len(lon), 5, 5))
    by_parallax = velocity / AU_PER_YEAR * r
    # With the place the local axes turn, and with them the motion.
    turn_p = (np.tan(lat) * (q * motion[0] - p * motion[1]) - r * motion[0]) * UAS
    turn_q = -r * motion[1] * UAS
    columns = (
        (p * (1 + zeta * t) + turn_p * t, p * zeta + turn_p, 0.0),
        (q * (1 + zeta * t) + turn_q * t, q * zeta + turn_q, 0.0),
        (by_parallax * t, by_parallax, 1.0),
        (p * t, p, 0.0),
        (q * t, q, 0.0),
    )
    for k, (db, drate, dparallax) in enumerate(columns):
        df = -(f**2) * np.sum(r_end * db, 0)
        dr = f * db + b * df
        dacross = df / f * across + f * (drate - dr * away - r_end * (np.sum(dr * rate, 0) + np.sum(r_end * drate, 0)))
        east = np.sum(p_end * dr, 0)
        turn = np.tan(later[1]) * east * np.stack([np.sum(q_end * across, 0), -np.sum(p_end * across, 0)])
        jacobian[:, 0, k], jacobian[:, 1, k] = east, np.sum(q_end * dr, 0)
        jacobian[:, 2, k] = dparallax * f + parallax * UAS * df
        jacobian[:, 3, k] = np.sum(p_end * dacross, 0) + turn[0]
        jacobian[:, 4, k] = np.sum(q_end * dacross, 0) + turn[1]
    return later, jacobian


def _with_light_time(lon, lat, parallax, motion, velocity, start, end):
    """ERFA's propagation; a parallax that is none is made small there, which is no fault of the data."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        new = erfa.pmsafe(
            lon, lat, motion[0] * UAS / np.cos(lat), motion[1] * UAS, np.maximum(parallax, 0) * UAS / _ARCSEC, velocity,
            2451545.0, (start - 2000.0) * 365.25, 2451545.0, (end - 2000.0) * 365.25,
        )  # fmt: skip
    new_lon, new_lat, by_lon, by_lat, new_parallax, _ = new
    small = parallax * UAS / _ARCSEC < 1e-6  # what ERFA has put in its place is not the star's
    return np.stack(
        [
            new_lon % (2 * np.pi),
            new_lat,
            np.where(small, parallax, new_parallax * _ARCSEC / UAS),
            by_lon * np.cos(new_lat) / UAS,
            by_lat / UAS,
        ]
    )


def earth(epoch: ArrayLike) -> FloatArray:
    """The Earth from the barycentre of the Solar System, (3, n), ICRS, to some km (ERFA's `epv00`). [au]

    Parameters
    ----------
    epoch : (n,) array
        [Julian year]
    """
    days = (np.asarray(epoch, float) - 2000.0) * 365.25
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        _, barycentric = erfa.epv00(2451545.0, days)
    return np.asarray(barycentric["p"]).T
