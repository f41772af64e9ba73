"""Vector spherical harmonics on the sky: the nouns and the mathematics.

Angles are in radians and proper motions in µas/yr, everywhere below this line.
"""

from importlib import import_module

from vsh import apex, conventions, redshifts
from vsh.coefficients import Coefficients
from vsh.errors import VshError, VshWarning
from vsh.field import Field
from vsh.modes import Mode, Modes
from vsh.vector import Vector

__version__ = "0.1.0"
__all__ = [
    "Coefficients",
    "Field",
    "Mode",
    "Modes",
    "Vector",
    "VshError",
    "VshWarning",
    "apex",
    "conventions",
    "redshifts",
]

# Rooms with heavy friends open on the first visit: `vsh.catalogue` imports astropy then.
_LAZY = {"catalogue", "cosmology", "pixels", "plot", "rotate", "tables", "transform"}


def __getattr__(name):
    if name in _LAZY:
        return import_module(f"vsh.{name}")
    raise AttributeError(f"module 'vsh' has no attribute {name!r}")


def __dir__():
    return sorted({*globals(), *_LAZY})
