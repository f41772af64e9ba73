"""The frame of Gaia's bright stars, which turns against that of its quasars."""

import numpy as np

from vsh.field import Field
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import FieldError
from vsh.tools.types import ArrayLike, FloatArray

__all__ = ["CANTAT_GAUDIN_BRANDT_2021"]

#: From this magnitude on the frame does not turn.
BRIGHT = 13.0
#: Magnitudes up to which each spin holds, and the spin along the axes of the ICRS; beyond there is none. [µas/yr]
_UPPER_MAGNITUDES = (9.0, 9.5, 10.0, 10.5, 11.0, 11.5, 11.75, 12.0, 12.25, 12.5, 12.75, BRIGHT)
_SPIN = np.array([
    [18.4, 33.8, -11.3], [14.0, 30.7, -19.4], [12.8, 31.4, -11.8], [13.6, 35.7, -10.5], [16.2, 50.0, 2.1],
    [19.4, 59.9, 0.2], [21.8, 64.2, 1.0], [17.7, 65.6, -1.9], [21.3, 74.8, 2.1], [25.7, 73.6, 1.0],
    [27.3, 76.6, 0.5], [34.9, 68.9, -2.9], [0.0, 0.0, 0.0],
])  # fmt: skip


def published_spin(magnitude: ArrayLike) -> FloatArray:
    """The spin of (E)DR3's frame at G magnitudes by Cantat-Gaudin & Brandt (2021), (…, 3), ICRS axes. [µas/yr]

    Parameters
    ----------
    magnitude : array of any shape
        Magnitudes in G. The spin is zero from 13 on.
    """
    return _SPIN[np.searchsorted(_UPPER_MAGNITUDES, magnitude, "right")]


@arguments.accepts(field=arguments.a(Field))
def CANTAT_GAUDIN_BRANDT_2021(field: Field) -> FloatArray:
    """Motions by which the frame of (E)DR3's stars brighter than G = 13 turns, (2, n): east and north. [µas/yr]

    Parameters
    ----------
    field : Field
        Sources with G magnitudes, in any axes. `field.corrected(CANTAT_GAUDIN_BRANDT_2021)` has the motions without it.

    Raises
    ------
    FieldError
        If a source has no magnitude.

    Notes
    -----
    Cantat-Gaudin & Brandt (2021, A&A 649, A124), table 1. `fit.frames.link` estimates the same from stars that VLBI
    knows, with errors.

    Examples
    --------
    >>> field = Field([0.0, 0.0], [0.0, 0.0], [[0.0, 0.0]] * 2, [[1.0, 1.0]] * 2, magnitude=[12.9, 14.0])
    >>> field.corrected(CANTAT_GAUDIN_BRANDT_2021).motion.round(1).tolist()
    [[2.9, 0.0], [68.9, 0.0]]
    """
    magnitude = np.full(len(field), np.nan) if field.magnitude is None else field.magnitude
    if n_missing := int(np.isnan(magnitude).sum()):
        raise FieldError(
            f"{n_missing} of {len(field)} sources have no magnitude, on which the frame of bright stars depends"
        )
    spin = rotation_matrix("icrs", field.frame) @ published_spin(magnitude).T
    p, q, _ = triad(field.lon, field.lat)
    return np.stack([(spin * q).sum(0), -(spin * p).sum(0)])
