"""The check of arguments that are sources: fields, or parts of a catalogue."""

from __future__ import annotations

from typing import Any

from vsh.field import field_or_fields
from vsh.parts._parts import Parts


def fields_or_parts(name: str, value: Any) -> Any:
    """A Field, Parts, or a list, tuple or stream of Fields."""
    return value if isinstance(value, Parts) else field_or_fields(name, value)
