"""Sources and attitude solved together, as Gaia's astrometric global iterative solution does (AGIS), at full scale."""

from sim.agis._cost import Plan, plan
from sim.agis._globals import GlobalMotion, global_motion
from sim.agis._observations import observations, start_errors
from sim.agis._scaled import scaled
from sim.agis._scans import Scans, scans
from sim.agis._solution import AgisSolution, rotate_frame
from sim.agis._system import System

__all__ = [
    "AgisSolution",
    "GlobalMotion",
    "Plan",
    "Scans",
    "System",
    "global_motion",
    "observations",
    "plan",
    "rotate_frame",
    "scaled",
    "scans",
    "start_errors",
]
