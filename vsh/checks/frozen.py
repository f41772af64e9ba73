"""Nouns whose arrays cannot be written to, also after a pickle or a deep copy."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, cast

import numpy as np

from vsh.checks.arrays import read_only
from vsh.checks.notebook import InNotebook


class Frozen(InNotebook):
    """Base of frozen dataclasses that hold arrays: every array attribute becomes a read-only view."""

    def __post_init__(self) -> None:
        for each in fields(cast(Any, self)):
            value = getattr(self, each.name)
            if isinstance(value, (np.ndarray, list)):
                object.__setattr__(self, each.name, _frozen(value))

    def __setstate__(self, state):
        # NumPy gives back arrays that can be written to.
        for name, value in state.items():
            object.__setattr__(self, name, _frozen(value))


def _frozen(value):
    if isinstance(value, np.ndarray):
        return read_only(value)
    if isinstance(value, list):
        return [_frozen(each) for each in value]
    return value
