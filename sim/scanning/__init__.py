"""The nominal scanning law, and the Sun it keeps away from."""

from sim.scanning._law import BLOCK, NominalScanningLaw
from sim.scanning._sun import sun_position, sun_rate
from sim.scanning._transits import Transits

__all__ = [
    "NominalScanningLaw",
    "Transits",
    "sun_position",
    "sun_rate",
]
