"""Transits in the order of time, and passes over them: what sources and attitude make of each other."""

from sim.agis.passes._cost import Plan, check_memory, plan, system_memory
from sim.agis.passes._make import Passes, make_passes
from sim.agis.passes._scaled import FULL, scaled
from sim.agis.passes._scans import Scans, scans
from sim.agis.passes._spline import smooth

__all__: list[str] = []
