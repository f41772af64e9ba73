"""Scalar fields on the sky: parallaxes, differences of magnitudes or colours, ratios of errors."""

from vsh.scalars._coefficients import DIPOLE, ScalarCoefficients
from vsh.scalars._field import ScalarField, modes_for

__all__ = [
    "ScalarCoefficients",
    "ScalarField",
]
