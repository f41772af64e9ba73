"""True fields, which add."""

from sim.signal._peculiar import in_time, peculiar, secular_parallax, wave_in_time
from sim.signal._signal import (
    Signal,
    acceleration,
    anisotropic_expansion,
    as_signal,
    from_coefficients,
    plane_wave,
    random_field,
    spin,
    systematics,
    wave_background,
)

__all__: list[str] = []
