"""What a mission would do to sources, without drawing it: formal and true covariances of their solutions."""

import numpy as np

from sim.astrometry import expected, solve, transit_error, unit_errors
from sim.scanning import BLOCK
from vsh.errors import FrameError, ParameterError
from vsh.system.parallel import map_blocks

_COLUMNS = {"motion": [3, 4], "position": [0, 1]}


def expected_covariances(
    population,
    mission,
    what="motion",
    release="DR4",
    variability=None,
    attitude=10.0,
    excess=0.0,
    threads=None,
    progress=True,
):
    """Formal and true 2 × 2 covariances of five-parameter solutions over a mission.

    Parameters
    ----------
    population : Population — in the mission's frame
    mission : NominalScanningLaw
    what : {"motion", "position"}
    release, variability, attitude, excess, threads, progress
        As for `sim.observe`; the attitude's error is taken for independent from transit to transit.

    Returns
    -------
    formal, true : (n, 2, 2) arrays
        As quoted, and as the errors scatter: with the wandering and the attitude. nan for sources with
        too few transits. [µas² or (µas/yr)²]
    """
    if what not in _COLUMNS:
        raise ParameterError(f"covariances are of motion or position, not {what!r}")
    if population.frame != mission.frame:
        raise FrameError(f"positions are in {population.frame}, the mission's in {mission.frame}")
    first, last = _COLUMNS[what]
    columns = slice(first, last + 1)
    error = np.hypot(transit_error(population.magnitude, mission, release, unit_errors(mission)), excess)

    def block(part):
        transits = mission.transits_of_block(population.lon[part], population.lat[part])
        return expected(transits, error[part], mission.years, variability, attitude)

    parts = list(map_blocks(block, len(population), BLOCK, threads, "transits" if progress else None))
    formal, true = (np.concatenate(each)[:, columns, columns] for each in zip(*parts, strict=True))
    return formal, true


def scanned_errors(magnitude, lon, lat, law, release="DR3", nside=16):
    """Errors and correlation of µ_α* and µ_δ by magnitude and place, without simulating each transit.

    The scanning law is followed for the centre of every HEALPix pixel; a source has the errors
    of its pixel, scaled by its magnitude.

    Parameters
    ----------
    magnitude, lon, lat : (n,) arrays — G, and positions in the law's frame [rad]
    law : NominalScanningLaw
    release : str — whose sky-mean parallax error
    nside : int — of the pixels

    Returns
    -------
    sigma : (2, n) array [µas/yr]
    rho : (n,) array
    """
    from vsh.sky.pixels import centres, pixels_of  # healpy

    pixel = pixels_of(lon, lat, nside)
    there = solve(law.transits(*centres(nside)), np.ones(12 * nside**2), 0, law.years)
    covariance = there.covariance[pixel][:, 3:, 3:]
    error = transit_error(magnitude, law, release, unit_errors(law))
    unit = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    return error * unit, covariance[:, 0, 1] / (unit[0] * unit[1])
