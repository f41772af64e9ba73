"""The frames a field may stand in, and the rotations between them (from astropy)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vsh.errors import FrameError
from vsh.types import FloatArray

__all__ = [
    "FRAMES",
    "check_frame",
    "rotation_matrix",
]

#: Our names and astropy's. "ecliptic" is the mean ecliptic and equinox of J2000, barycentric.
FRAMES = {"icrs": "icrs", "galactic": "galactic", "ecliptic": "barycentricmeanecliptic"}


def check_frame(name: str) -> str:
    """Return `name` if it is a known frame; raise FrameError otherwise.

    Parameters
    ----------
    name : str
        A frame.

    Returns
    -------
    str

    Raises
    ------
    FrameError
        If nobody knows it.
    """
    if not isinstance(name, str) or name not in FRAMES:
        raise FrameError(f"unknown frame {name!r}: choose one of {', '.join(FRAMES)}")
    return name


def rotation_matrix(frame: str, to: str) -> FloatArray:
    """The matrix A of r' = A r, from the axes of `frame` to those of `to`.

    Parameters
    ----------
    frame : str
        From which.
    to : str
        To which.

    Returns
    -------
    (3, 3) array, read-only

    Raises
    ------
    FrameError
        If either name is unknown.

    Examples
    --------
    The Galactic centre in ICRS, as a unit vector:

    >>> rotation_matrix("galactic", "icrs")[:, 0].round(4)
    array([-0.0549, -0.8734, -0.4838])
    """
    return _rotation(check_frame(frame), check_frame(to))


@lru_cache
def _rotation(frame, to):
    # Heavy: for those who change frames.
    from astropy.coordinates import CartesianRepresentation, SkyCoord

    axes = SkyCoord(CartesianRepresentation(np.eye(3)), frame=FRAMES[frame])
    matrix = axes.transform_to(FRAMES[to]).cartesian.xyz.value
    matrix.flags.writeable = False
    return matrix
