"""Whether the errors of a study hold: truth against mean, scatter against formal errors, coverage (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vsh.plot import COLOURS, WIDTH, legend_above, panels, styled

_MARKS = "os^Dv<>P"
#: Of how many parameters names are still read.
_NAMED = 24


@styled
def plot_calibration(rows: Sequence[Mapping[str, Any]], *, ax: Any = None) -> Any:
    """Every parameter of a study: how far its mean is from the truth, its scatter over its formal error, and coverage.

    Each with the error that the number of realisations leaves it.
    """
    cases = list(dict.fromkeys(row["case"] for row in rows))
    names = list(dict.fromkeys(row["parameter"] for row in rows))
    width = max(WIDTH, 0.16 * len(names) + 0.8)
    off, scatter, coverage = drawn = panels(ax, 3, 1, size=(width, 4.6), sharex=True)
    for i, case in enumerate(cases):
        own = [row for row in rows if row["case"] == case]
        shift = (i - (len(cases) - 1) / 2) * 0.6 / max(1, len(cases))
        x = np.array([names.index(row["parameter"]) for row in own]) + shift
        value = {key: np.array([row[key] for row in own], float) for key in own[0] if key not in ("case", "parameter")}
        colour, mark = COLOURS[i % len(COLOURS)], _MARKS[i % len(_MARKS)]
        n = value["n"]
        with np.errstate(divide="ignore", invalid="ignore"):
            style = {"color": colour, "fmt": mark, "markersize": 2.5, "linewidth": 0.7}
            off.errorbar(x, (value["mean"] - value["truth"]) / value["std"], 1 / np.sqrt(n), label=case, **style)
            scatter.errorbar(x, value["std"] / value["sigma"], value["std_error"] / value["sigma"], **style)
        for share, open_ in ((68, False), (95, True)):
            face = {"markerfacecolor": "white"} if open_ else {}
            coverage.errorbar(x, value[f"within_{share}"], value[f"within_{share}_error"], **style, **face)
    off.axhline(0, color="0.5", linewidth=0.6, zorder=0)
    off.set_ylabel("(mean − truth)\n/ scatter")
    scatter.axhline(1, color="0.5", linewidth=0.6, zorder=0)
    scatter.set_ylabel("scatter\n/ formal error")
    for level in (0.6827, 0.95):
        coverage.axhline(level, color="0.5", linewidth=0.6, zorder=0)
    coverage.set_ylim(0, 1.05)
    coverage.set_ylabel("truth within\n68 % (95 %: open)")
    step = -(-len(names) // _NAMED) if len(names) > 4 * _NAMED else 1
    coverage.set_xticks(range(0, len(names), step), names[::step], rotation=90, fontsize=6)
    legend_above(off, 4)
    return drawn
