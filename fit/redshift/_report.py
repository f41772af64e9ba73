"""Dipoles in bins of redshift as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fit.output import WIDTH, components, note_lines, p_value
from fit.redshift._shared import FLOW_MATTERS
from vsh.vector import Vector

#: A p-value below this is called a difference; the Gaussian's three σ.
_REMARKABLE = 0.0027
#: From so many sources on what they share over the sky matters beside their noise.
_MANY = 100_000


def text_of(binned: Any, velocity: Vector | None, p_values: Mapping[str, float] | None = None) -> str:
    """Dipoles in bins of redshift as text: a table, and whether the bins differ.

    Every hypothesis is tested three ways: with errors as quoted, with the errors of each bin multiplied by
    the root of its own χ²/dof, and by permuting redshifts. It is called contradicted where both of the last
    two say so (the second alone where there are no permutations).
    """
    lines = [f"Bins of redshift ({binned.frame} axes, degree 1 to {binned.modes.lmax})", "─" * WIDTH]
    lines.append(f"{'z':>17}{'sources':>9}{'χ²/dof':>8}{'spin':>26}{'acceleration [µas/yr]':>28}")
    for b, solution in enumerate(binned.solutions):
        edges = f"{binned.edges[b]:.4g} – {binned.edges[b + 1]:.4g}"
        cells = zip(components(solution.spin), components(solution.acceleration), strict=True)
        for row, (axis, pair) in enumerate(zip("xyz", cells, strict=True)):
            left = f"{edges:>17}{binned.counts[b]:9d}{solution.reduced_chi2:8.2f}" if row == 0 else " " * 34
            lines.append(f"{left}   {axis}{pair[0]:>22}{pair[1]:>27}")
    for b, solution in enumerate(binned.solutions):
        if solution.quality.warning():
            lines.append(f"warning: bin {b + 1}: {solution.quality.warning()}")
    if any(solution.dof < 34 for solution in binned.solutions):
        lines.append("warning: a bin has fewer than 20 sources, too few to tell the scale of its errors")
    tests = {"T": ("spin alike in all bins", binned.equality("T", 1))}
    tests["S"] = ("acceleration alike in all bins", binned.equality("S", 1))
    if len(binned) > 1:
        tests["trend"] = ("no slope of either with redshift", binned.trend().test)
    if velocity is not None and np.isfinite(binned.mean_inverse_distance).all():
        tests["secular_parallax"] = (
            f"constant ã − v/d, |v| = {velocity.amplitude:.0f} km/s",
            binned.secular_parallax(velocity)[1],
        )
    if binned.counts.sum() >= _MANY and binned.modes.lmax < 7:
        lines.append(
            "warning: errors that sources share over the sky, as Gaia's, are not in the p-values: with them p < 0.05 on 11 to 14 % of skies "
            "at degrees 1 to 3. --lmax 7 (degree 7) gives 3 to 7 % where the bins cover the same sky; where they cover different skies it does not help"
        )
    if binned.flow_share > 0.01:
        lines.append(f"errors and p-values hold flows that galaxies share: {binned.flow}")
    lines += ["", f"{'p-values':36}{'χ² (dof)':>16}{'as quoted':>11}{'scaled':>9}{'permuted':>10}"]
    for key, (name, test) in tests.items():
        if test.dof == 0:
            continue
        permuted = (p_values or {}).get(key)
        believed = test.p_value if permuted is None else max(test.p_value, permuted)
        line = (
            f"{name:36}{test.quoted:10.2f} ({test.dof:3d}){p_value(test.p_value_quoted):>11}{p_value(test.p_value):>9}"
        )
        line += f"{'–' if permuted is None else p_value(permuted):>10}"
        lines.append(f"{line}  {'contradicted' if believed < _REMARKABLE else 'not contradicted'}")
    if p_values is None and binned.flow_share > FLOW_MATTERS and binned.modes.lmax == 1 and len(binned) > 1:
        lines.append("permuted: not computed, since redshifts dealt out anew tear the flow apart that neighbours share")
    elif p_values is None and binned.modes.lmax == 1 and len(binned) > 1:
        lines.append(
            "permuted: not computed here (fit.redshift.permutation_test does; vsh-redshift up to 20000 sources)"
        )
    return "\n".join([*lines, *note_lines(binned.notes)]) + "\n"
