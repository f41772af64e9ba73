"""Some of the sources of a catalogue in parts, for figures."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from vsh.field import Field
from vsh.parts._parts import Parts


def sample_of(sky: Parts, n_sources: int = 20_000) -> Field:
    """Some of the sources as a Field, every k-th of each part, for figures."""
    step = max(1, sky.counted() // n_sources)
    columns: dict[str, Any] = sky.sum(partial(_every, step=step), roles=(), words="a sample")
    frame = columns.pop("frame")[0]
    joined: dict[str, Any] = {name: np.concatenate(values, axis=-1) for name, values in columns.items()}
    return Field(**joined, frame=frame)


def _every(field, step):
    some = field[::step]
    return {name: [getattr(some, name)] for name in ("lon", "lat", "motion", "sigma", "rho", "frame")}
