"""One plane gravitational wave: the motions that it gives to sources far away, and their coefficients."""

from vsh.waves._wave import degree_amplitudes, strain_of, unit, wave_coefficients, wave_motions, wave_templates

__all__ = [
    "degree_amplitudes",
    "strain_of",
    "wave_coefficients",
    "wave_motions",
    "wave_templates",
]
