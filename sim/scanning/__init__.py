"""Where and when Gaia looks: the nominal scanning law and its transits, laws from tables, gaps, and the Sun."""

from sim.scanning._gaps import gaps_of
from sim.scanning._nominal import BLOCK as BLOCK
from sim.scanning._nominal import NominalScanningLaw
from sim.scanning._nominal import Transits as Transits
from sim.scanning._sun import sun_position as sun_position
from sim.scanning._tabulated import TabulatedLaw

__all__ = ["NominalScanningLaw", "TabulatedLaw", "gaps_of"]
