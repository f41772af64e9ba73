"""The motions that a flow gives to sources."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsh.field import Field
from vsh.flows import FlowModes, VelocityGrid
from vsh.sky.sphere import triad
from vsh.types import FloatArray
from vsh.units import SPEED_OF_LIGHT


@dataclass(frozen=True, eq=False)
class FlowRows:
    """Columns of the equations for the modes of a flow, along the axes of the error ellipses.

    The flow moves redshifts as well, and with them the distances at which motions are expected. That is a product of
    two velocities that are not known, ours less the flow across, and the flow along: it is scatter, and stands among
    the errors of distances. Taken as v_⊥ V_r alone, with our own velocity known, it would tell the flow where it tells
    nothing: with 60 000 galaxies errors of v come out 1.5 times too small.

    Attributes
    ----------
    modes : FlowModes
    lon, lat, distance : (n,) arrays
        [rad, Mpc/h]
    rate : (n,) array
        [µas/yr per km/s]
    cos, sin : (n,) arrays
        Of the ellipses' directions.
    """

    modes: FlowModes
    lon: FloatArray
    lat: FloatArray
    distance: FloatArray
    rate: FloatArray
    cos: FloatArray
    sin: FloatArray

    def rows(self, part: slice) -> FloatArray:
        """The columns of some sources, (2k, p): the first components of all, then the second. [µas/yr]

        Parameters
        ----------
        part : slice
            Which sources.
        """
        (east, north), _ = self.modes.at(self.lon[part], self.lat[part], self.distance[part])
        cos, sin = self.cos[part, None] * self.rate[part, None], self.sin[part, None] * self.rate[part, None]
        return np.concatenate([cos * east + sin * north, cos * north - sin * east])


def known_flow(
    grid: VelocityGrid, field: Field, distance: FloatArray, slope: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Velocities that are known from elsewhere: across, what they do to 1/d by the redshift, and a note.

    Parameters
    ----------
    grid : VelocityGrid
        The velocities.
    field : Field
        The sources.
    distance : (n,) array
        [Mpc/h]
    slope : (n,) array
        By how much the mean of 1/d changes with ln(1 + z_obs).

    Returns
    -------
    across : (2, n) array
        [km/s]
    shift : (n,) array
        Of the mean of 1/d.
    notes : tuple of str
    """
    velocity, inside = grid.at(field.lon, field.lat, distance, field.frame)
    p, q, r = triad(field.lon, field.lat)
    across, along = np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)]), np.sum(velocity * r, 0)
    outside = int((~inside).sum())
    note = f"{outside} sources lie outside of the reconstructed flow, which is taken as zero there"
    return across, -slope * along / SPEED_OF_LIGHT, (note,) if outside else ()
