"""True fields that change with time: displacements of the sky, for epochs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.signal._signal import Signal, TimeDependent
from vsh.models.waves import unit, wave_motions
from vsh.tools.arguments import number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray


@dataclass(frozen=True)
class SwingingWave(TimeDependent):
    """One plane gravitational wave of a frequency within the mission."""

    direction: FloatArray
    frequency: float
    plus: float
    cross: float
    phase: float

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        swing = np.cos(2 * np.pi * self.frequency * time + self.phase)
        return wave_motions(lon, lat, self.direction, self.plus, self.cross) * swing


@dataclass(frozen=True)
class AnyInTime(TimeDependent):
    """Any function of position and time."""

    function: Callable[[Any, Any, Any], Any]

    def displacement(self, lon: FloatArray, lat: FloatArray, time: FloatArray) -> FloatArray:
        """Displacements of sources at `lon`, `lat` [rad], a `time` each [yr since the epoch], (2, k). [µas]"""
        moved = np.asarray(self.function(lon, lat, time), float)
        if moved.shape != (2, len(time)) or not np.isfinite(moved).all():
            raise ParameterError(f"displacements are (2, {len(time)}) numbers, east and north, not of {moved.shape}")
        return moved


def wave_in_time(
    direction: ArrayLike, frequency: float, plus: float, cross: float = 0.0, *, phase: float = 0.0
) -> Signal:
    """One plane gravitational wave that swings within the mission, for `sim.epochs`.

    Parameters
    ----------
    direction : (3,) array
        Where it travels to, along the axes of the frame; of any length.
    frequency : float
        [1/yr]
    plus, cross : float
        Strains of the two polarisations, as for `plane_wave`; 1 µas is 4.8e-12. [µas]
    phase : float
        At the reference epoch. [rad]

    Notes
    -----
    The exact response at the Earth, of waves much shorter than the distances of the sources; both polarisations in
    phase. Two calls with other phases add.

    Examples
    --------
    >>> wave_in_time((0, 0, 1), 0.5, 2.0).displacement([0.0], [0.0], [0.0]).round(12).ravel()
    array([0., 1.])
    """
    strains = number("plus", plus), number("cross", cross)
    return Signal((SwingingWave(unit(direction), positive("frequency", frequency), *strains, number("phase", phase)),))


def in_time(function: Callable[[Any, Any, Any], Any]) -> Signal:
    """Any displacement of the sky that changes with time, for `sim.epochs`.

    Parameters
    ----------
    function : function of (lon, lat, time)
        From positions [rad] and times since the reference epoch [yr], each (k,), to displacements east and north, (2,
        k). [µas]

    Raises
    ------
    ParameterError
        If it is no function.

    Examples
    --------
    >>> turning = in_time(lambda time, lon, lat: np.stack([10 * np.sin(time) * np.cos(lat), 0 * lat]))
    >>> isinstance(turning, Signal)
    True
    """
    if not callable(function):
        raise ParameterError(f"a displacement is a function of (lon, lat, time), not {function!r}")
    return Signal((AnyInTime(function),))
