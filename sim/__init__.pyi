"""What `sim` holds: for type checkers, and for whoever asks (lazy_loader reads the imports here)."""

from . import agis, astrometry, gaia, population, scanning, signal, skies, variability
from .astrometry import gaia_errors
from .expected import expected_covariances, scan_maps
from .gaia import crf3, crf4, epochs, link
from .mission import Mission
from .observing import observe, observe_offsets
from .population import (
    Population,
    clustered_galaxies,
    galaxies,
    plane_avoiding_sky,
    quasars,
    stars,
    uniform_sky,
    vlbi_quasars,
)
from .scanning import NominalScanningLaw, TabulatedLaw, find_gaps
from .signal import (
    Signal,
    acceleration,
    anisotropic_expansion,
    from_coefficients,
    in_time,
    peculiar,
    plane_wave,
    random_field,
    secular_parallax,
    spin,
    systematics,
    wave_background,
    wave_in_time,
)
from .variability import Variability

__all__ = [
    "Mission",
    "NominalScanningLaw",
    "Population",
    "Signal",
    "TabulatedLaw",
    "Variability",
    "acceleration",
    "agis",
    "anisotropic_expansion",
    "astrometry",
    "clustered_galaxies",
    "crf3",
    "crf4",
    "epochs",
    "expected_covariances",
    "find_gaps",
    "from_coefficients",
    "gaia",
    "gaia_errors",
    "galaxies",
    "in_time",
    "link",
    "observe",
    "observe_offsets",
    "peculiar",
    "plane_avoiding_sky",
    "plane_wave",
    "population",
    "quasars",
    "random_field",
    "scan_maps",
    "scanning",
    "secular_parallax",
    "signal",
    "skies",
    "spin",
    "stars",
    "systematics",
    "uniform_sky",
    "variability",
    "vlbi_quasars",
    "wave_background",
    "wave_in_time",
]
