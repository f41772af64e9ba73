"""Where and when Gaia looks: the nominal scanning law and its transits, laws from tables, gaps, and the Sun."""

from sim.scanning._crossings import TabulatedLaw, find_gaps
from sim.scanning._crossings import sun_position as sun_position
from sim.scanning._nominal import BLOCK as BLOCK
from sim.scanning._nominal import NominalScanningLaw
from sim.scanning._nominal import Transits as Transits

__all__ = ["NominalScanningLaw", "TabulatedLaw", "find_gaps"]
