"""A matrix of correlations with names a reader knows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from vsh.checks.types import Axes, FloatArray
from vsh.plot._style import DIVERGING

#: So many rows have a name each, and so many a number in each cell.
NAMED, NUMBERED = 30, 8
_LETTERS = {"epsilon_": r"\epsilon", "omega_": r"\omega", "a_": r"\tilde a"}


def symbol(name: str) -> str:
    """A parameter's name as it is written: ω_x, ã_x, t(2,0)."""
    for plain, letter in _LETTERS.items():
        if name.startswith(plain):
            return f"${letter}_{name[len(plain) :]}$"
    return name


def draw_matrix(axes: Axes, matrix: FloatArray, names: Sequence[str], groups: Sequence[str] | None = None) -> Any:
    """Correlations as colours about zero, with their values where there is room; the diagonal left out."""
    k = len(names)
    off = np.where(np.eye(k) > 0, np.nan, matrix)
    reach = max(float(np.nanmax(np.abs(off))) if k > 1 else 0.0, 1e-3)
    axes.set_facecolor("0.85")
    image = axes.imshow(off, cmap=DIVERGING, vmin=-reach, vmax=reach)
    axes.spines[["top", "right"]].set_visible(True)
    axes.tick_params(length=0)
    if groups is not None and len(set(groups)) > 1:
        first = [i for i in range(k) if i == 0 or groups[i] != groups[i - 1]]
        for i in first[1:]:
            heavy = groups[i][:1] != groups[i - 1][:1]
            for line in (axes.axhline, axes.axvline):
                line(i - 0.5, color="0.4" if heavy else "0.6", linewidth=0.8 if heavy else 0.25 if k <= 60 else 0.1)
    if k > NAMED and groups is not None:
        ends = [*first, k]
        middles = [(a + b - 1) / 2 for a, b in pairwise(ends)]
        words = [groups[i] for i in first]
        # The narrow ones of the lowest degrees would lie on each other.
        shown = [i for i, (a, b) in enumerate(pairwise(ends)) if b - a > k / 22]
        axes.set_xticks([middles[i] for i in shown], [words[i] for i in shown])
        axes.set_yticks([middles[i] for i in shown], [words[i] for i in shown])
    else:
        every = max(1, k // NAMED)
        size = 8 if k <= 9 else 6 if k <= 20 else 4.5
        axes.set_xticks(range(0, k, every), list(names)[::every], rotation=0 if k <= 9 else 90, fontsize=size)
        axes.set_yticks(range(0, k, every), list(names)[::every], fontsize=size)
    if k <= NUMBERED:
        for (row, column), value in np.ndenumerate(off):
            if np.isfinite(value):
                white = abs(value) > 0.6 * reach
                axes.text(column, row, f"{value:+.2f}".replace("-", "−"), ha="center", va="center", fontsize=6.5, color="w" if white else "k")  # fmt: skip
    return image
