"""Vector spherical harmonics of proper motions: coefficients, fields and catalogues.

Inside, angles are in radians and proper motions in µas/yr.
"""

from typing import TYPE_CHECKING

import lazy_loader

from vsh import conventions
from vsh.coefficients import Coefficients
from vsh.errors import (
    ArchiveError,
    CheckpointError,
    ConvergenceError,
    CovarianceError,
    DegeneracyError,
    FieldError,
    FrameError,
    ModesError,
    NothingLeftError,
    NothingSelectedError,
    ParameterError,
    TableError,
    VshError,
    VshWarning,
)
from vsh.field import Field
from vsh.modes import Mode, Modes, ScalarModes
from vsh.scalars import ScalarCoefficients, ScalarField
from vsh.vector import Vector

if TYPE_CHECKING:
    from vsh import archive, catalogue, cosmology, covariance, epochs, rotate, sky, tables, transform, waves

__version__ = "0.1.0"
__all__ = [
    "ArchiveError",
    "CheckpointError",
    "Coefficients",
    "ConvergenceError",
    "CovarianceError",
    "DegeneracyError",
    "Field",
    "FieldError",
    "FrameError",
    "Mode",
    "Modes",
    "ModesError",
    "NothingLeftError",
    "NothingSelectedError",
    "ParameterError",
    "ScalarCoefficients",
    "ScalarField",
    "ScalarModes",
    "TableError",
    "Vector",
    "VshError",
    "VshWarning",
    "archive",
    "catalogue",
    "conventions",
    "cosmology",
    "covariance",
    "epochs",
    "rotate",
    "sky",
    "tables",
    "transform",
    "waves",
]

# Imported when first asked for: astropy, healpy, ducc0 and matplotlib come with them.
__getattr__, _, _ = lazy_loader.attach(
    __name__,
    ["archive", "catalogue", "cosmology", "covariance", "epochs", "rotate", "sky", "tables", "transform", "waves"],
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
