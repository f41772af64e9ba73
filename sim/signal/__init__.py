"""True fields, which add."""

from sim.signal._expansion import anisotropic_expansion, off_centre_void
from sim.signal._galaxies import hubble_rate, secular_parallax
from sim.signal._peculiar import peculiar
from sim.signal._random import gravitational_waves, random_field, wave_fractions
from sim.signal._signal import Signal, acceleration, as_signal, from_coefficients, spin

__all__ = [
    "Signal",
    "acceleration",
    "anisotropic_expansion",
    "as_signal",
    "from_coefficients",
    "gravitational_waves",
    "hubble_rate",
    "off_centre_void",
    "peculiar",
    "random_field",
    "secular_parallax",
    "spin",
    "wave_fractions",
]
