"""Backgrounds of known shape and unknown amplitude: systematic floors, gravitational waves, evidence."""

from fit.background._floor import Floor, floor
from vsh.covariance import Spectrum

__all__ = [
    "Floor",
    "Spectrum",
    "floor",
]
