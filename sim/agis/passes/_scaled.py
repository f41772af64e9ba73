"""A mission scaled to fewer sources, as in AGISLab (Holl, Lindegren & Hobbs 2012, A&A 543, A15)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.scanning import NominalScanningLaw
from vsh.checks import arguments
from vsh.errors import ParameterError

#: Half of the height that a field may have. [rad]
_WIDEST = 0.5
#: Quasars of the paper, at whose number nothing is scaled.
FULL = 500_000


def scaled(n: int, law: NominalScanningLaw | None = None, *, knots: float = 30.0, full: int = FULL) -> tuple[NominalScanningLaw, float]:  # fmt: skip
    """A scanning law and knots with which n sources are seen as `full` ones are by the whole mission.

    As many sources in a field, observations in an interval and transits of a source: with s = n/full the fields are
    1/√s as wide and the satellite turns √s as fast, so that knots are 1/s as far apart.

    Examples
    --------
    >>> law, knots = scaled(5000)
    >>> round(law.spin_rate, 9), round(knots, 9)
    (6.0, 3000.0)
    """
    share = arguments.whole("n", n) / arguments.whole("full", full)
    law = NominalScanningLaw() if law is None else arguments.a(NominalScanningLaw)("law", law)
    root = share**0.5
    if law.half_height / root > _WIDEST:
        least = int(np.ceil(full * (law.half_height / _WIDEST) ** 2))
        raise ParameterError(
            f"{n} sources are too few to stand for {full}: a field would be {np.degrees(2 * law.half_height / root):.0f}° high. "
            f"Take {least} or more, or scale nothing"
        )
    # Gaps that were drawn are kept as they are.
    kept = {"dead_time": 0.0, "rng": None, "gaps": tuple(map(tuple, law.lost))}
    wide = replace(law, half_height=law.half_height / root, spin_rate=law.spin_rate * root, **kept)
    return wide, arguments.positive("knots", knots) / share
