"""Sources and attitude solved together, as Gaia's astrometric global iterative solution does (AGIS), at full scale."""

from sim.agis._calibration import GAIA_CALIBRATION, Calibration
from sim.agis._globals import GlobalMotion, MotionFit, global_motion
from sim.agis._mission import (
    KINDS,
    Mixture,
    in_own_frame,
    joint_system,
    mixture,
    observations,
    solve_mission,
    start_errors,
)
from sim.agis._response import Response
from sim.agis._results import AgisSolution
from sim.agis._system import System
from sim.agis.passes import FULL, Plan, Scans, plan, scaled, scans

__all__ = [
    "AgisSolution",
    "Calibration",
    "GlobalMotion",
    "Mixture",
    "Response",
    "System",
    "global_motion",
    "joint_system",
    "mixture",
    "observations",
    "plan",
    "scans",
    "solve_mission",
]
