"""In which frame a redshift stands, and the way from one to another.

A redshift that an observer measures holds the source's own velocity and the observer's: (1 + z_obs) =
(1 + z) (1 + v_r/c)/(1 + v·r/c), with v the observer's velocity with respect to the microwave background, toward the
apex. Frames differ by that observer.
"""

from __future__ import annotations

import numpy as np

from vsh.checks.types import FloatArray
from vsh.cosmology._apex import PLANCK_2018
from vsh.sky.frames import rotation_matrix
from vsh.sky.redshift_frames import TRUE
from vsh.sky.sphere import triad
from vsh.units import SPEED_OF_LIGHT
from vsh.vector import Vector

#: Karachentsev & Makarov (1996, AJ 111, 794): the Sun's velocity with respect to the Local Group. [km/s]
SUN_IN_LOCAL_GROUP = Vector.from_spherical(316.0, 93.0, -4.0, frame="galactic", unit="km/s")
#: Kogut et al. (1993, ApJ 419, 1): the velocity of the Local Group in the microwave background. [km/s]
LOCAL_GROUP = Vector.from_spherical(627.0, 276.0, 30.0, (22.0, 3.0, 3.0), "galactic", "km/s")
_NONE = Vector(np.zeros(3), np.zeros((3, 3)), "galactic", "km/s")

#: The Sun's velocity with respect to the observer at rest in each frame of redshifts. [km/s]
REDSHIFT_FRAMES = {"heliocentric": _NONE, "cmb": PLANCK_2018, "local-group": SUN_IN_LOCAL_GROUP}


def to_cmb(redshift: FloatArray, lon: FloatArray, lat: FloatArray, frame: str, redshift_frame: str) -> FloatArray:
    """Redshifts as an observer at rest in the microwave background would measure them.

    With the velocity of Planck (2018), never one that was fitted: what is fitted would bear on itself.

    Parameters
    ----------
    redshift : (n,) array
        As measured.
    lon, lat : (n,) arrays
        Positions. [rad]
    frame : str
        Of the positions.
    redshift_frame : str
        Of `REDSHIFT_FRAMES`; "true" ones stay as they are.

    Examples
    --------
    >>> apex = PLANCK_2018.to_frame("icrs").direction
    >>> float(to_cmb(np.array([0.01]), *np.radians([[apex[0]], [apex[1]]]), "icrs", "heliocentric")[0].round(6))
    0.011246
    """
    redshift = np.asarray(redshift, float)
    if redshift_frame == TRUE:
        return redshift
    r = triad(lon, lat)[2]
    turn = rotation_matrix("galactic", frame)
    toward = {name: turn @ REDSHIFT_FRAMES[name].value @ r / SPEED_OF_LIGHT for name in ("cmb", redshift_frame)}
    return (1 + redshift) * (1 + toward["cmb"]) / (1 + toward[redshift_frame]) - 1
