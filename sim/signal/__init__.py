"""True fields, which add."""

from sim.signal._expansion import anisotropic_expansion, void
from sim.signal._galaxies import drift, hubble_rate, peculiar
from sim.signal._random import isotropic, wave_fractions, waves
from sim.signal._signal import Signal, acceleration, as_signal, field, spin

__all__ = [
    "Signal",
    "acceleration",
    "anisotropic_expansion",
    "as_signal",
    "drift",
    "field",
    "hubble_rate",
    "isotropic",
    "peculiar",
    "spin",
    "void",
    "wave_fractions",
    "waves",
]
