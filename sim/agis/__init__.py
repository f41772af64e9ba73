"""Sources and attitude solved together, as Gaia's astrometric global iterative solution does (AGIS), at full scale."""

from sim.agis._globals import GlobalMotion, global_motion
from sim.agis._mission import joint_system, solve_mission
from sim.agis._observations import observations, start_errors
from sim.agis._system import System
from sim.agis.passes import Plan, Scans, plan, scaled, scans
from sim.agis.results import AgisSolution, correlation_by_angle, ratio_by, rotate_frame

__all__ = [
    "AgisSolution",
    "GlobalMotion",
    "Plan",
    "Scans",
    "System",
    "correlation_by_angle",
    "global_motion",
    "joint_system",
    "observations",
    "plan",
    "ratio_by",
    "rotate_frame",
    "scaled",
    "scans",
    "solve_mission",
    "start_errors",
]
