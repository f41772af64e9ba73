"""Flows of galaxies in linear theory: how their velocities are correlated, as modes, and on grids.

Distances are in Mpc/h, so that they follow from redshifts whatever the Hubble constant; velocities are in km/s, in the
frame of the microwave background.
"""

from vsh.flows._grid import VelocityGrid, read_velocity_grid
from vsh.flows._modes import FARTHEST, FlowModes, flow_modes
from vsh.flows._theory import HUBBLE, PLANCK_2018, LinearTheory

__all__ = [
    "PLANCK_2018",
    "FlowModes",
    "LinearTheory",
    "VelocityGrid",
    "flow_modes",
    "read_velocity_grid",
]
