"""Transits in the order of time, and passes over them: what sources and attitude make of each other."""

from sim.agis.passes._cost import FULL, Plan, check_memory, plan, scaled, system_memory
from sim.agis.passes._make import Passes, make_passes
from sim.agis.passes._scans import Scans, scans, smooth

__all__: list[str] = []
