"""The motions that a flow gives to sources: directly, and by what it does to their redshifts.

A velocity V of a source moves it by k V_⊥. Its radial part moves the redshift as well, and with it the distance at
which our own motion is expected: by v_⊥ k' V_r/c, with k' the change of the mean of 1/d with ln(1 + z_obs).
"""

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

    Attributes
    ----------
    modes : FlowModes
    lon, lat, distance : (n,) arrays
        [rad, Mpc/h]
    rate : (n,) array
        [µas/yr per km/s]
    pull : (2, n) array
        What a radial velocity of 1 km/s does by the redshift, east and north. [µas/yr per km/s]
    cos, sin : (n,) arrays
        Of the ellipses' directions.
    """

    modes: FlowModes
    lon: FloatArray
    lat: FloatArray
    distance: FloatArray
    rate: FloatArray
    pull: FloatArray
    cos: FloatArray
    sin: FloatArray

    def rows(self, part: slice) -> FloatArray:
        """The columns of some sources, (2k, p): the first components of all, then the second. [µas/yr]

        Parameters
        ----------
        part : slice
            Which sources.
        """
        tangential, radial = self.modes.at(self.lon[part], self.lat[part], self.distance[part])
        tangential *= self.rate[part, None]
        tangential += self.pull[:, part, None] * radial
        cos, sin = self.cos[part, None], self.sin[part, None]
        return np.concatenate([cos * tangential[0] + sin * tangential[1], cos * tangential[1] - sin * tangential[0]])


def _pull(field, slope, ours):
    """v_⊥ k'/c, (2, n)."""
    p, q, _ = triad(field.lon, field.lat)
    return np.stack([ours @ p, ours @ q]) * slope / SPEED_OF_LIGHT


def flow_rows(
    modes: FlowModes, field: Field, distance: FloatArray, rate: FloatArray, slope: FloatArray, ours: FloatArray,
    cos: FloatArray, sin: FloatArray,
) -> FlowRows:  # fmt: skip
    """The columns of a field.

    Parameters
    ----------
    modes : FlowModes
        Of the flow.
    field : Field
        The sources.
    distance : (n,) array
        [Mpc/h]
    rate, slope : (n,) arrays
        Of `fit.distances.InverseDistances`.
    ours : (3,) array
        Our velocity, fixed. [km/s]
    cos, sin : (n,) arrays
        Of the ellipses' directions.
    """
    return FlowRows(modes, field.lon, field.lat, distance, rate, _pull(field, slope, ours), cos, sin)


def shared_motion(
    grid: VelocityGrid, field: Field, distance: FloatArray, rate: FloatArray, slope: FloatArray, ours: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """The motions by velocities that are known from elsewhere, (2, n), and a note on sources outside. [µas/yr]

    Parameters
    ----------
    grid : VelocityGrid
        The velocities.
    field, distance, rate, slope, ours
        As for `flow_rows`.
    """
    velocity, inside = grid.at(field.lon, field.lat, distance, field.frame)
    p, q, r = triad(field.lon, field.lat)
    across, along = np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)]), np.sum(velocity * r, 0)
    outside = int((~inside).sum())
    note = (
        (f"{outside} sources lie outside of the reconstructed flow, which is taken as zero there",) if outside else ()
    )
    return rate * across + _pull(field, slope, ours) * along, note
