"""Where a survey sees: densities on the sky from which positions are drawn.

A sky is a HEALPix map of the density of sources, in ring order and Galactic or other axes. The two of Bachchan, Hobbs &
Lindegren (2016) are built from what is known of them, not from their results: GUMS is all of the sky but the Galactic
plane, where extinction hides quasars; the Initial Gaia Quasar List is a sum of surveys, each with its footprint.
"""

import numpy as np

from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import centres, draw_map_positions
from vsh.sky.sphere import angles, triad
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray, Rng

__all__ = ["sky_map"]

NSIDE = 64

#: GUMS: latitude up to which the plane hides quasars, how much higher that is towards the Galactic
#: centre (and lower away from it), and the scale over which they appear. [deg] The second was set
#: to the paper's correlation table, whose GUMS sky has fewer quasars on the side of the centre.
GUMS_PLANE = (12.0, 3.0, 3.0)

#: Share of the IGQL's sources that each kind of survey brings. The list's authors give no numbers
#: by area: these shares were set so that the sky ties spin to acceleration as in the paper's
#: correlation table, under the errors of the scanning law. They are the only parameters that were.
IGQL_SHARES = {
    "SDSS north cap": 0.26, "far north": 0.27, "equatorial south": 0.14, "equatorial north": 0.11, "2QZ south": 0.07,
    "2QZ north": 0.06, "northern sky": 0.07, "all sky": 0.02,
}  # fmt: skip


def sky_map(sky: str) -> tuple[FloatArray, str]:
    """The density of a named sky, (12 · 64²,), and the frame of its axes.

    Parameters
    ----------
    sky : {"uniform", "plane-avoiding", "gums", "igql"}
        A name.

    Raises
    ------
    ParameterError
        If the name is unknown.
    """
    density_makers = {
        "uniform": lambda: np.ones(12 * NSIDE**2),
        "plane-avoiding": lambda: (np.abs(_compute_galactic_pixel_centres()[1]) > 15).astype(float),
        "gums": _make_gums_density,
        "igql": _make_igql_density,
    }
    if not isinstance(sky, str) or sky not in density_makers:
        raise ParameterError(f"unknown sky {sky!r}: choose one of {', '.join(density_makers)}, or give a HEALPix map")
    return density_makers[sky](), "galactic"


def draw_positions(
    n: int, rng: Rng, sky: str | FloatArray = "uniform", map_frame: str = "icrs"
) -> tuple[FloatArray, FloatArray]:
    """n positions in ICRS, with the density of a sky. [rad]"""
    density, frame = sky_map(sky) if isinstance(sky, str) else (sky, map_frame)
    lon, lat = draw_map_positions(density, n, rng)
    return angles(rotation_matrix(frame, "icrs") @ triad(lon, lat)[2])


def _make_gums_density():
    edge_latitude, edge_swing, edge_width = GUMS_PLANE
    l, b = _compute_galactic_pixel_centres()
    return 1 / (1 + np.exp(-(np.abs(b) - edge_latitude - edge_swing * np.cos(np.radians(l))) / edge_width))


def _make_igql_density():
    """Fill the footprint of each survey evenly with its share of the sources."""
    b = _compute_galactic_pixel_centres()[1]
    ra, dec = np.degrees(angles(rotation_matrix("galactic", "icrs") @ triad(*centres(NSIDE))[2]))
    outside_plane = np.abs(b) > 15
    footprints = {
        # Spectroscopy and imaging of SDSS in the northern Galactic cap (Ahn et al. 2014, ApJS 211, 17).
        "SDSS north cap": (ra > 115) & (ra < 255) & (dec > -4) & (dec < 65) & (b > 28),
        # What only northern observatories reach, and their sky at large.
        "far north": outside_plane & (dec > 30),
        "northern sky": outside_plane & (dec > 0),
        # Bands along the equator, stripe 82 of SDSS among them, in either Galactic cap.
        "equatorial north": (b > 20) & (np.abs(dec) < 10),
        "equatorial south": (b < -20) & (np.abs(dec) < 10),
        # The two strips of 2QZ (Croom et al. 2004, MNRAS 349, 1397).
        "2QZ north": (ra > 147) & (ra < 222) & (np.abs(dec) < 3),
        "2QZ south": ((ra > 325) | (ra < 48.75)) & (dec > -33) & (dec < -27),
        # X-ray, radio and infrared identifications: thinly everywhere, and alone in the south.
        "all sky": outside_plane,
    }
    return sum(share * footprints[name] / footprints[name].sum() for name, share in IGQL_SHARES.items())


def _compute_galactic_pixel_centres():
    return np.degrees(centres(NSIDE))
