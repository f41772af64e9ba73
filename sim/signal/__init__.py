"""True fields, which add."""

from sim.signal._expansion import anisotropic_expansion, off_centre_void
from sim.signal._galaxies import secular_parallax
from sim.signal._peculiar import peculiar
from sim.signal._random import gravitational_waves, random_field, systematics
from sim.signal._signal import Signal, acceleration, as_signal, from_coefficients, spin
from sim.signal._wave import wave
from vsh.covariance import wave_fractions
from vsh.units import hubble_rate

__all__ = [
    "Signal",
    "acceleration",
    "anisotropic_expansion",
    "from_coefficients",
    "gravitational_waves",
    "hubble_rate",
    "off_centre_void",
    "peculiar",
    "random_field",
    "secular_parallax",
    "spin",
    "systematics",
    "wave",
]
