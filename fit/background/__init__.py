"""Backgrounds of known shape and unknown amplitude: systematic floors, gravitational waves, evidence.

What sources share is a Gaussian field of a known spectrum. Its amplitude is estimated by the exact likelihood of the normal
equations, with whatever else is fitted marginalised.
"""

from fit.background._amplitude import Amplitude, equations_of
from fit.background._evidence import Comparison, compare, evidence
from fit.background._fit import Background, fit
from fit.background._floor import Floor, add_floor, floor
from fit.background._waves import WaveLimit, wave_limit
from vsh.models.covariance import Spectrum

__all__ = [
    "Amplitude",
    "Background",
    "Comparison",
    "Floor",
    "WaveLimit",
    "add_floor",
    "compare",
    "evidence",
    "fit",
    "floor",
    "wave_limit",
]
