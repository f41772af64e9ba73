"""A chain as arviz knows chains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vsh.checks.types import FloatArray
from vsh.system.quiet import import_quietly

_AXES = ("x", "y", "z")


def inference_data(
    samples: Mapping[str, FloatArray], log_probability: FloatArray | None, frame: str, units: Mapping[str, str]
) -> Any:
    """arviz' InferenceData (its DataTree from version 1 on) of samples, each (chains, draws)."""
    try:
        arviz = import_quietly("arviz")
    except ImportError:
        raise ImportError("arviz is not installed: pip install 'vsh-astrometry[arviz]'") from None
    variables = dict(samples)
    about = {name: {"unit": units.get(name, "")} for name in variables}
    for vector, letter in (("velocity", "v"), ("acceleration", "a")):
        parts = [f"{letter}_{axis}" for axis in _AXES]
        if set(parts) <= set(samples):
            variables[vector] = np.stack([samples[part] for part in parts], axis=-1)
            about[vector] = {"unit": units.get(parts[0], ""), "frame": frame}
    vectors = [name for name, values in variables.items() if np.ndim(values) == 3]
    where = {"coords": {"axis": list(_AXES)}, "dims": {name: ["axis"] for name in vectors}}
    groups: dict[str, Any] = {"posterior": variables}
    groups |= {} if log_probability is None else {"sample_stats": {"lp": log_probability}}
    new = int(arviz.__version__.split(".")[0]) >= 1
    found = arviz.from_dict(groups, **where) if new else arviz.from_dict(**groups, **where)
    for name, facts in about.items():
        found["posterior"][name].attrs.update(facts)
    return found
