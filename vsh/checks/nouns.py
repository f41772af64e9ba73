"""Checks for arguments that are nouns of ours."""

from __future__ import annotations

from typing import Any

from vsh.errors import ParameterError
from vsh.field import Field
from vsh.modes import Modes, ScalarModes, as_modes
from vsh.scalars import ScalarField


def modes(name: str, value: Any) -> Modes:
    """`Modes`, or a degree in their place."""
    return as_modes(value)


def modes_for(field: Any, value: Any) -> Modes:
    """The modes in which a field is expanded: `ScalarModes` of a ScalarField, `Modes` of anything else.

    Examples
    --------
    >>> modes_for(None, 2)
    Modes(lmax=2)
    """
    return as_modes(value, ScalarModes if isinstance(field, ScalarField) else Modes)


def fields(name: str, value: Any) -> Any:
    """A Field, or a list, tuple or stream of Fields."""
    if isinstance(value, Field):
        return value
    if isinstance(value, (list, tuple)) and value and all(isinstance(each, Field) for each in value):
        return value
    if hasattr(value, "__next__"):
        return value
    raise ParameterError(f"{name} must be a Field, or a list or stream of Fields, not {type(value).__name__}")
