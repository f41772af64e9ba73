"""Flows in a fit: their columns in the equations, and the flow that was found, anywhere within its reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.output import WIDTH, amplitude, components, direction
from fit.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.models.flows import FlowModes, VelocityGrid
from vsh.sky.sphere import across_and_along
from vsh.tools.arguments import positive
from vsh.tools.types import AxesArray, FloatArray, IntArray, OnAxes, Table
from vsh.tools.units import SPEED_OF_LIGHT
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class FlowRows:
    """Columns of the equations for the modes of a flow, along the axes of the error ellipses.

    The flow moves redshifts as well, and with them the distances at which motions are expected. That is a product of
    two velocities that are not known, ours less the flow across, and the flow along: it is scatter, and stands among
    the errors of distances. Taken as v_⊥ V_r alone, with our own velocity known, it would tell the flow where it tells
    nothing: with 60 000 galaxies errors of v come out 1.5 times too small.
    """

    modes: FlowModes
    lon: FloatArray
    lat: FloatArray
    distance: FloatArray
    rate: FloatArray
    cos: FloatArray
    sin: FloatArray

    def only(self, index: IntArray) -> FlowRows:
        """Those of some sources."""
        names = ("lon", "lat", "distance", "rate", "cos", "sin")
        return FlowRows(self.modes, *(getattr(self, name)[index] for name in names))

    def rows(self, part: slice) -> FloatArray:
        """The columns of some sources, (2k, p): the first components of all, then the second. [µas/yr]"""
        cos, sin = self.cos[part] * self.rate[part], self.sin[part] * self.rate[part]
        turn = np.stack([[cos, sin], [-sin, cos]])
        columns = self.modes.columns(self.lon[part], self.lat[part], self.distance[part], turn)
        return columns.reshape(len(self.modes), -1).T


def known_flow(
    grid: VelocityGrid, field: Field, distance: FloatArray, slope: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Velocities that are known from elsewhere: across, what they do to 1/d by the redshift, and a note."""
    velocity, inside = grid.at(field.lon, field.lat, distance, field.frame)
    across, along = across_and_along(velocity, field.lon, field.lat)
    outside = int((~inside).sum())
    note = f"{outside} sources lie outside of the reconstructed flow, which is taken as zero there"
    return across, -slope * along / SPEED_OF_LIGHT, (note,) if outside else ()


@dataclass(frozen=True, eq=False, repr=False)
class Flow(Result):
    """Amplitudes of the modes of a flow, with their covariance.

    Attributes
    ----------
    modes : vsh.models.flows.FlowModes
    values : (p,) array
        One on average before the motions were seen.
    covariance : (p, p) array
        That of the other parameters of the fit included.
    frame : str
        Frame of the axes.
    """

    modes: FlowModes
    values: FloatArray
    covariance: FloatArray
    frame: str

    def __repr__(self) -> str:
        return f"<Flow: {self.modes!r}, {self.frame}>"

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities in the frame of the microwave background: tangential, (2, n), and radial, (n,). [km/s]

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        distance : (n,) array
            [Mpc/h]
        """
        tangential, radial = self.modes.at(lon, lat, distance)
        return tangential @ self.values, radial @ self.values

    def bulk(self, radius: float) -> Vector:
        """The mean velocity at distance `radius` [Mpc/h], over all directions, with its covariance. [km/s]"""
        rows = _shell_mean(self.modes, positive("radius", radius))
        return Vector(rows @ self.values, rows @ self.covariance @ rows.T, self.frame, "km/s")

    def report(self) -> str:
        """The bulk flow by distance as text."""
        lines = [
            f"The flow of galaxies, {self.modes.theory.name} as its prior, {len(self.modes)} modes",
            "─" * WIDTH,
            f"{'Mpc/h':>8}  mean velocity of a shell, {self.frame} axes [km/s]",
        ]
        for radius in self._radii():
            v = self.bulk(radius)
            cells = "".join(f"{cell:>17}" for cell in components(v))
            lines.append(f"{radius:8.0f}{cells}  |V| {amplitude(v)}  {direction(v.to_frame('galactic'))}")
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """Mean velocities of shells as an astropy Table, a row each."""
        radii = self._radii()
        bulks = [self.bulk(radius) for radius in radii]
        columns: dict[str, Any] = {"distance": radii}
        for i, axis in enumerate("xyz"):
            columns[f"v_{axis}"] = [v.value[i] for v in bulks]
            columns[f"v_{axis}_error"] = [v.sigma[i] for v in bulks]
        return tables.table_of(columns, {"frame": self.frame})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """The radial velocities that were found on three shells, on matplotlib axes."""
        from fit.secular_parallax._plot import plot_flow

        return plot_flow(self, ax=ax)

    def _radii(self):
        last = self.modes.radii[-1]
        return [radius for radius in (10.0, 20.0, 40.0, 80.0, 160.0, 320.0) if radius <= last] or [float(last)]


def _shell_mean(modes, radius):
    """What every mode adds to the mean velocity over a shell, (3, p): (f_r + 2 f_t)/3 e for degree 1, else nothing."""
    places, quarter, far = np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, 0.0, np.pi / 2]), np.full(3, radius)
    along = modes.at(places, quarter, far)[1]  # outwards on the axes x, y, z
    across = modes.at(places[:2], quarter[:2], far[:2])[0]  # on x, east is y and north z; on y, east is −x
    toward = np.stack([-across[0, 1], across[0, 0], across[1, 0]])
    one = slice(modes.counts[0], modes.counts[0] + 3 * modes.counts[1])
    rows = np.zeros_like(along)
    rows[:, one] = (along[:, one] + 2 * toward[:, one]) / 3
    return rows


def flow_of(
    rows: Any, amplitudes: Any, theta: FloatArray, to_u: FloatArray, covariance: FloatArray, ratio: float
) -> Flow:
    """The flow of a fit, from its amplitudes given the other parameters."""
    slope = amplitudes.slope @ to_u
    values = (amplitudes.mean - amplitudes.slope @ theta) / ratio
    total = (amplitudes.covariance + slope @ covariance @ slope.T) / ratio**2
    return Flow(rows.modes, values, (total + total.T) / 2, rows.frame)
