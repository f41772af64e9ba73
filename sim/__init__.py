"""Skies with a known truth."""

from sim.noise import gaia_errors
from sim.observe import observe
from sim.population import Population, plane_avoiding_sky, quasars, uniform_sky
from sim.signal import Signal, acceleration, field, spin

__all__ = [
    "Population",
    "Signal",
    "acceleration",
    "field",
    "gaia_errors",
    "observe",
    "plane_avoiding_sky",
    "quasars",
    "spin",
    "uniform_sky",
]
