"""Skies with a known truth."""

from importlib import import_module

from sim import astrometry, population, scanning, signal, variability
from sim.expected import expected_covariances
from sim.noise import gaia_errors
from sim.observe import observe, observe_offsets
from sim.population import Population, galaxies, plane_avoiding_sky, quasars, uniform_sky, vlbi_quasars
from sim.scanning import NominalScanningLaw
from sim.signal import (
    Signal,
    acceleration,
    anisotropic_expansion,
    drift,
    field,
    isotropic,
    peculiar,
    spin,
    void,
    waves,
)
from sim.variability import Variability

__all__ = [
    "NominalScanningLaw",
    "Population",
    "Signal",
    "Variability",
    "acceleration",
    "anisotropic_expansion",
    "astrometry",
    "drift",
    "expected_covariances",
    "field",
    "gaia_errors",
    "galaxies",
    "isotropic",
    "observe",
    "observe_offsets",
    "peculiar",
    "plane_avoiding_sky",
    "population",
    "quasars",
    "scanning",
    "signal",
    "spin",
    "uniform_sky",
    "variability",
    "vlbi_quasars",
    "void",
    "waves",
]

# Rooms with heavy friends open on the first visit.
_LAZY = {"effects", "plot", "skies"}


def __getattr__(name):
    if name in _LAZY:
        return import_module(f"sim.{name}")
    raise AttributeError(f"module 'sim' has no attribute {name!r}")


def __dir__():
    return sorted({*globals(), *_LAZY})
