"""True fields, which add."""

from sim.signal._peculiar import peculiar, secular_parallax
from sim.signal._signal import (
    Signal,
    acceleration,
    anisotropic_expansion,
    as_signal,
    from_coefficients,
    gravitational_waves,
    off_centre_void,
    random_field,
    spin,
    systematics,
)
from sim.signal._wave import wave
from vsh.models.covariance import wave_fractions
from vsh.tools.units import hubble_rate

__all__: list[str] = []
