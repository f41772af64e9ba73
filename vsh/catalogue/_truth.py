"""What a simulated table says it was made with."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh import tables
from vsh.vector import Vector


def truth_of(source: Any) -> dict[str, Any] | None:
    """The spin and acceleration that a simulated table says it was made with, or None.

    Read from its metadata: SPIN_X … ACC_Z, ICRS components in µas/yr, and for galaxies VEL_X … VEL_Z
    (km/s, toward the apex) and HUBBLE (km/s/Mpc).
    """
    meta = {str(key).upper(): value for key, value in tables.open_table(source).meta.items()}

    def vector(key, unit="µas/yr"):
        return Vector([float(meta[f"{key}_{axis}"]) for axis in "XYZ"], np.zeros((3, 3)), unit=unit)

    try:
        truth = {"spin": vector("SPIN"), "acceleration": vector("ACC")}
    except (KeyError, TypeError, ValueError):
        return None
    try:
        return truth | {"velocity": vector("VEL", "km/s"), "hubble": float(meta["HUBBLE"])}
    except (KeyError, TypeError, ValueError):
        return truth
