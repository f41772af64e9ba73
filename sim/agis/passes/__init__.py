"""Transits in the order of time, and passes over them: what sources and attitude make of each other."""

from sim.agis.passes._make import Passes, make_passes
from sim.agis.passes._scans import FULL, Plan, Scans, add_smoothing, check_memory, plan, scaled, scans, system_memory

__all__: list[str] = []
