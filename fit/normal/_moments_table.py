"""Moments as the columns of a table, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.storage import count, exact, number, words
from vsh.errors import TableError
from vsh.modes import Modes, ScalarModes


def shapes(kind: type[Modes], lmax: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The shapes of moments of weights and of values."""
    weights, values = (1, 1) if kind is ScalarModes else (3, 2)
    return (weights, 2 * lmax + 1, 4 * lmax + 1), (values, lmax + 1, 2 * lmax + 1)


def packed(moments: Any) -> tuple[dict[str, Any], dict[str, Any], dict[str, str]]:
    """Columns, the rest as plain values, units of columns: what `Result._pack` gives."""
    kinds, m, n, values = [], [], [], []
    for names, each, half in (("abc", moments.weights, 2 * moments.lmax), ("en", moments.motions, moments.lmax)):
        for name, grid in zip(names, each, strict=False):  # a and e alone of a scalar field
            place = np.indices(grid.shape)
            kinds += [name] * grid.size
            m.append(place[0].ravel())
            n.append(place[1].ravel() - half)
            values.append(grid.ravel())
    found = np.concatenate(values)
    columns = {
        "of": kinds, "m": np.concatenate(m), "n": np.concatenate(n), "real": found.real, "imaginary": found.imag,
    }  # fmt: skip
    rest = {
        "lmax": moments.lmax, "chi2_null": exact(moments.chi2_null), "n_data": moments.n_data, "frame": moments.frame,
        "unit": moments.unit, "notes": list(map(str, moments.notes)),
    }  # fmt: skip
    return columns, rest, {}


def unpacked(columns: dict[str, Any], rest: dict[str, Any]) -> dict[str, Any]:
    """The attributes of moments from what was written."""
    kind = Modes if "b" in columns["of"] else ScalarModes
    lmax = kind(rest["lmax"]).lmax
    values = np.asarray(columns["real"], float) + 1j * np.asarray(columns["imaginary"], float)
    if not np.isfinite(values).all():
        raise TableError("moments that are not finite")
    of_weights, of_values = shapes(kind, lmax)
    split = int(np.prod(of_weights))
    return {
        "lmax": lmax, "weights": values[:split].reshape(of_weights), "motions": values[split:].reshape(of_values),
        "chi2_null": number(rest["chi2_null"]), "n_data": count(rest["n_data"]), "frame": rest["frame"],
        "notes": words(rest["notes"]), "unit": str(rest["unit"]),
    }  # fmt: skip
