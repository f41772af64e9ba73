"""Where and when Gaia looks: the nominal scanning law and its transits, laws from tables, gaps, and the Sun."""

from sim.scanning._crossings import DEAD_TIME, TabulatedLaw, find_gaps, is_outside_gaps, sun_position
from sim.scanning._nominal import BLOCK, NominalScanningLaw, Transits

__all__ = ["NominalScanningLaw", "TabulatedLaw", "find_gaps"]
