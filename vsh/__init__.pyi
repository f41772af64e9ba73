"""What `vsh` holds: for type checkers, and for whoever asks (lazy_loader reads the imports here)."""

from . import conventions, figures, io, models, rotate, sky, transform
from .classes import Classes
from .coefficients import Coefficients
from .field import Field
from .io.catalogue import read_field
from .io.results import read
from .modes import Mode, Modes, ScalarModes
from .scalars import ScalarCoefficients, ScalarField
from .tools.errors import (
    ArchiveError,
    CheckpointError,
    ConvergenceError,
    CovarianceError,
    DegeneracyError,
    EmptyFieldError,
    EmptySelectionError,
    FieldError,
    FrameError,
    ModesError,
    ParameterError,
    TableError,
    VshError,
    VshWarning,
    WriteError,
)
from .vector import Vector

__version__: str

__all__ = [
    "ArchiveError",
    "CheckpointError",
    "Classes",
    "Coefficients",
    "ConvergenceError",
    "CovarianceError",
    "DegeneracyError",
    "EmptyFieldError",
    "EmptySelectionError",
    "Field",
    "FieldError",
    "FrameError",
    "Mode",
    "Modes",
    "ModesError",
    "ParameterError",
    "ScalarCoefficients",
    "ScalarField",
    "ScalarModes",
    "TableError",
    "Vector",
    "VshError",
    "VshWarning",
    "WriteError",
    "conventions",
    "figures",
    "io",
    "models",
    "read",
    "read_field",
    "rotate",
    "sky",
    "transform",
]
