"""Skies with a known truth."""

from typing import TYPE_CHECKING

import lazy_loader

from sim import agis, astrometry, population, scanning, signal, variability
from sim.expected import expected_covariances
from sim.mission import Mission
from sim.noise import gaia_errors
from sim.observe import observe, observe_offsets
from sim.population import (
    Population,
    clustered_galaxies,
    galaxies,
    plane_avoiding_sky,
    quasars,
    stars,
    uniform_sky,
    vlbi_quasars,
)
from sim.scanning import NominalScanningLaw
from sim.signal import (
    Signal,
    acceleration,
    anisotropic_expansion,
    from_coefficients,
    gravitational_waves,
    off_centre_void,
    peculiar,
    random_field,
    secular_parallax,
    spin,
    systematics,
    wave,
)
from sim.variability import Variability

if TYPE_CHECKING:
    from sim import effects, gaia, plot, skies
    from sim.gaia import crf3, epochs

__all__ = [
    "Mission",
    "NominalScanningLaw",
    "Population",
    "Signal",
    "Variability",
    "acceleration",
    "agis",
    "anisotropic_expansion",
    "astrometry",
    "clustered_galaxies",
    "crf3",
    "effects",
    "epochs",
    "expected_covariances",
    "from_coefficients",
    "gaia",
    "gaia_errors",
    "galaxies",
    "gravitational_waves",
    "observe",
    "observe_offsets",
    "off_centre_void",
    "peculiar",
    "plane_avoiding_sky",
    "plot",
    "population",
    "quasars",
    "random_field",
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
    "wave",
]

# Imported when first asked for: astropy, healpy and matplotlib come with them.
__getattr__, _, _ = lazy_loader.attach(__name__, ["effects", "gaia", "plot", "skies"], {"gaia": ["crf3", "epochs"]})


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
